"""What a patient lacks at a phase of the stride, by the estimate, and how much that counts.

Efforts are along the motion of the reference, in the mean of a pass: N·m or N. K is the stiffness
of the guidance in full, s the share of it in force, e the stray that assist tolerates, n' the stray
of the pass in units of e, m the assist of the pass; `gain` and f are those of `phase_help.py`.

    lack    = clip(need - patient, 0, need)
    missing = max(lack - K e, 0) gain / (gain + (1 - f) K)
    given   = max(m + s K e (n' - 1), 0)
    help    = min(missing, given)
    weight  = R / (R + sigma^2),  R = (K e)^2 / 3

The need is that of the reference's motion. So resistance counts as 0: what the motion does not need
is not given, however hard a patient pushes back.

What guidance gives is not given twice. Without a stray that is too large it gives K e. And help is
no more than what assist and guidance together gave beyond that in the pass: a leg that does not
stray needs no more, whatever the machine's file says of the need.

`gain / (gain + (1 - f) K)` is the share at which the law of the stray settles: help fades by 1 - f
in each stride, so that much of it must show as a stray. A patient who does less feels it.

There are two measures of the help: the estimate, with its sigma, and the stray. A stray up to e
says nothing about an effort between -K e and K e: R is the variance of a uniform distribution over
these. The two are combined by their inverse variances. So an estimate that is not sure counts less,
and the law of the stray takes its place.
Source: Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation",
2001, 3.4: two independent measurements of one quantity.
"""

from typing import NamedTuple


class Guided(NamedTuple):
    """What guidance does on one axis in a bin."""

    effort: float
    """K e, without a stray that is too large: N·m or N."""
    settled_ratio: float
    """gain / (gain + (1 - f) K)."""
    stiffness_ratio: float
    """s: of the full stiffness."""


def lacking(needed: float, patient: float) -> float:
    """Return clip(need - patient, 0, need).

    Args:
        needed: effort that the motion needs, along it; where it is against it, nothing is lacking.
        patient: effort of the patient along the motion; resistance is negative.
    """
    return min(max(needed - patient, 0.0), max(needed, 0.0))


def helping(lack: float, assist: float, stray_ratio: float, guided: Guided) -> float:
    """Return the help after a pass.

    Args:
        lack: of the pass.
        assist: m, of the pass.
        stray_ratio: n'.
        guided: of the axis.
    """
    missing = max(lack - guided.effort, 0.0) * guided.settled_ratio
    beyond = guided.stiffness_ratio * guided.effort * (stray_ratio - 1.0)
    return min(missing, max(assist + beyond, 0.0))


def weight(std: float, guided: float) -> float:
    """Return the share of the estimate in the help, 0 to 1; the rest is that of the stray.

    Args:
        std: sigma of the patient's effort.
        guided: K e; positive.
    """
    variance = guided * guided / 3.0
    return variance / (variance + std * std)
