"""How fast a patient's effort changes: a rate that predictions carry on.

The filter's patient is a random walk. A random walk expects no change, so its estimate lags behind
a patient whose effort rises for a tenth of a second, by as long as its gain takes. The rate is what
the last corrections had in common. Each prediction moves the patient's effort along it, so that the
correction has to find only what is new. It is a linear trend that fades (Gardner and McKenzie,
"Forecasting trends in time series", Management Science 31 (1985), eq. (4) to (6)), with a constant
gain beside the filter's own:

    effort += rate dt,    rate := fade rate + RATE_GAIN correction / dt

- It is no state of the filter, which would need a fifth more sigma points. Its own uncertainty is
  in the patient's noise: this follows the innovations to where they are white (leg_noise.py), and
  is smaller where the rate explains them.
- It needs the evidence of a working patient that raises this noise. Without one it stays near zero,
  so that the estimate of a passive patient stays quiet. Where no evidence is believed it is zero.
- It is zero while the joint has not certainly moved: at rest, at a reversal and without samples a
  change of the load may be friction's. Without `velocity_gated` this is not known, and it is zero.
- It fades within RATE_FADES_S: an effort that rises now does not rise much longer.
- A correction against it says that the effort has turned: most of the rate is dropped, so that the
  estimate hardly overshoots an effort that begins or ends at once.
- A correction of more than some steps of the random walk counts less: it is a step, no trend. After
  a push the filter's uncertainty allows such corrections; carried on, they would overshoot.
- A rejected sample says that what was expected is wrong: the rate begins anew.
"""

import math
from typing import Final

from observer.filter.leg_memory import LegMemory
from observer.filter.leg_model import STEP_S
from observer.jit import inline

RATE_GAIN: Final = 0.13
"""With more, the estimate overshoots a patient who begins at once; with less, it lags."""
RATE_FADES_S: Final = 0.1
"""As long as a patient's effort rises in a gait; a longer one overshoots a tremor."""
TURNED_SHARE: Final = 0.3
"""What is left of the rate after a correction against it."""
EXPECTED_STEPS: Final = 2.0
"""Correction, in steps of the random walk, beyond which it counts less, by the square."""


@inline
def carry_rate(m: LegMemory, dt_s: float) -> None:
    """Move the mean of each patient's effort along its rate."""
    m.mean[6] += m.patient_rate[0] * dt_s
    m.mean[7] += m.patient_rate[1] * dt_s


@inline
def fade_rate(m: LegMemory, dt_s: float) -> None:
    """Let both rates fade over one step."""
    share = fading(dt_s)
    m.patient_rate[0] *= share
    m.patient_rate[1] *= share


@inline
def fading(dt_s: float) -> float:
    """Return the share of a rate that a step leaves."""
    return math.exp(-dt_s / RATE_FADES_S)


@inline
def forget_rate(m: LegMemory) -> None:
    """Begin anew after a rejected sample."""
    m.patient_rate[0] = m.patient_rate[1] = 0.0


@inline
def follow_rate(m: LegMemory, axis: int, correction: float, dt_s: float) -> None:
    """Take the rate from what a sample corrected of the patient's effort (N·m, N)."""
    if correction * m.patient_rate[axis] < 0.0:
        m.rate_kept[axis] = TURNED_SHARE
        m.patient_rate[axis] *= TURNED_SHARE
    working = min(m.patient_ratio[axis], 1.0)
    expected = EXPECTED_STEPS * m.noise[6 + axis, 6 + axis]
    size = math.fabs(correction)
    usual = expected / size if size > expected else 1.0  # at rest both may be 0
    over_s = max(dt_s, STEP_S)  # two samples within a moment are no rate
    gain = RATE_GAIN * (working * usual) ** 2
    m.rate_gain[axis] = gain / over_s
    m.patient_rate[axis] += gain * correction / over_s
