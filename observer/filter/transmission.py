"""What an elastic or loose transmission hides from the encoder, in the published sigma.

The filter takes the encoder's position for that of the joint. Behind a transmission that gives way
the joint lags by the windup

    w(u) = c u + b/2 tanh(u / u_0)           compliance c, backlash b; u_0: gap_effort

of the drive's effort u. So the joint moves at v - w', and its friction changes its sign when the
joint turns, not when the encoder does: after a reversal the joint sticks while the spring is wound
up the other way. Where the encoder rests and the effort moves, the joint moves, too. This model has
two errors per axis, each the difference to a rigid one at the present pose, motion and effort:

    friction   e' = a(v - w') / T1 (F_s(v - w') - F - e) - a(v) / T1 (F_s(v) - F)
    net        M(q - w) (a - w'') + h(q - w, v - w') - M(q) a - h(q, v)

The first is eq. (11) with the law (13) at the joint's speed, less the filter's own step.

Shaft and joint swing against each other at 5 to 20 Hz, too fast for the filter: it shows such a
swing late and with another sign. So sigma holds not the error but its mean square over ENVELOPE_S.
The derivatives are those of the effort behind a critically damped low-pass of second order, which
lags about as much as the filter does. An axis with bristles has no e: its bristles give way like
the transmission, and are fitted with it.

Where the file calls the hip's transmission stiffer than LIKELY_COMPLIANCE and motion does not show
it (`surprise.py`), friction has the error of that. The shaft swings, so the joint may turn even
later: its sigma is at least what friction has just changed, times the doubt.

As with the friction law (`friction.law_variance`) nothing but what is published reads this.
"""

import math
from typing import Final

from observer.filter.leg_memory import LegMemory
from observer.filter.leg_model import LegModel
from observer.jit import inline
from observer.mechanism.friction import FrictionParameters, followed, static_friction
from observer.mechanism.linkage import accelerations, dynamics, efforts

FOLLOWED_S: Final = 0.02
"""Time constant of the low-pass, twice."""
ENVELOPE_S: Final = 0.1
LIKELY_COMPLIANCE: Final = 2e-3
"""rad/(N m), of the hip: 500 N m/rad is about the softest that innovations show. None at the slide:
what would hold the error of a soft one makes sigma of a recorded stiff one several times its
error."""
GAP_EFFORT: Final = (0.5, 5.0)
"""N m, N: a gap is open below this effort. The joint's own friction presses it close elsewhere."""


@inline
def hide(
    model: LegModel,
    compliance: tuple[float, float],
    doubt: float,
    backlash: tuple[float, float],
    m: LegMemory,
    dt_s: float,
) -> None:
    """Advance the variance that the transmissions hide, `hidden_friction` and `hidden_net`.

    Args:
        model: the physics of the filter.
        compliance: of the file, rad/(N m) and m/N.
        doubt: share of a likely compliance of the hip, 0 to 1: for friction alone, if it is larger.
        backlash: rad and m.
        m: after the step and its correction; written.
        dt_s: the step.
    """
    v1, v2 = m.mean[2], m.mean[3]
    hip, slide = _follow(m, 0, dt_s), _follow(m, 1, dt_s)
    share = 1.0 - math.exp(-dt_s / ENVELOPE_S)
    likely = max(doubt * LIKELY_COMPLIANCE, compliance[0])
    _, rate_hip, _ = _windup(likely, backlash[0], GAP_EFFORT[0], hip)
    _, rate_slide, _ = _windup(compliance[1], backlash[1], GAP_EFFORT[1], slide)
    late = (likely - compliance[0]) / LIKELY_COMPLIANCE
    _hide_friction(model.hip, m, 0, rate_hip, late, dt_s, share)
    _hide_friction(model.slide, m, 1, rate_slide, 0.0, dt_s, share)
    back_hip, rate_hip, bend_hip = _windup(compliance[0], backlash[0], GAP_EFFORT[0], hip)
    back_slide, rate_slide, bend_slide = _windup(compliance[1], backlash[1], GAP_EFFORT[1], slide)
    own = dynamics(model.leg, m.mean[0], m.mean[1], v1, v2, model.coriolis_share)
    a1, a2 = accelerations(
        own, m.acting[0] + m.mean[6] - m.mean[4], m.acting[1] + m.mean[7] - m.mean[5]
    )
    other = dynamics(
        model.leg,
        m.mean[0] - back_hip,
        m.mean[1] - back_slide,
        v1 - rate_hip,
        v2 - rate_slide,
        model.coriolis_share,
    )
    rigid, soft = efforts(own, a1, a2), efforts(other, a1 - bend_hip, a2 - bend_slide)
    for axis in range(2):
        error = soft[axis] - rigid[axis]
        m.hidden_net[axis] += share * (error * error - m.hidden_net[axis])


@inline
def _follow(m: LegMemory, axis: int, dt_s: float) -> tuple[float, float, float]:
    """Let the low-pass follow the effort for a step; return it and its two derivatives."""
    effort = m.acting[axis]
    away = m.followed_effort[axis] - effort
    slope = m.followed_rate[axis] + away / FOLLOWED_S
    decay = math.exp(-dt_s / FOLLOWED_S)
    left = (away + slope * dt_s) * decay
    rate = slope * decay - left / FOLLOWED_S
    bend = -(left / FOLLOWED_S + 2.0 * rate) / FOLLOWED_S
    m.followed_effort[axis], m.followed_rate[axis] = effort + left, rate
    return effort + left, rate, bend


@inline
def _windup(
    compliance: float, backlash: float, gap_effort: float, followed: tuple[float, float, float]
) -> tuple[float, float, float]:
    """The windup by an effort, and its two derivatives."""
    effort, rate, bend = followed
    inside = math.tanh(effort / gap_effort)
    opened = 0.5 * backlash * (1.0 - inside * inside) / gap_effort
    gives = compliance + opened
    curve = -2.0 * opened * inside / gap_effort
    return (
        compliance * effort + 0.5 * backlash * inside,
        gives * rate,
        gives * bend + curve * rate * rate,
    )


@inline
def _hide_friction(
    f: FrictionParameters,
    m: LegMemory,
    axis: int,
    windup_rate: float,
    late: float,
    dt_s: float,
    share: float,
) -> None:
    """Follow the joint's friction beside the filter's, and the mean square of their difference.

    The latter is at least the square of `late` times friction less its mean over ENVELOPE_S.
    """
    if f.bristle_stiffness > 0.0:
        return
    velocity, friction = m.mean[2 + axis], m.mean[4 + axis]
    of_joint = velocity - windup_rate
    error = m.hidden_error[axis]
    own = followed(f, velocity, dt_s) * (static_friction(f, velocity) - friction)
    error += followed(f, of_joint, dt_s) * (static_friction(f, of_joint) - friction - error) - own
    m.hidden_error[axis] = error
    m.usual_friction[axis] += share * (friction - m.usual_friction[axis])
    change = late * (friction - m.usual_friction[axis])
    hidden = m.hidden_friction[axis]
    m.hidden_friction[axis] = max(hidden + share * (error * error - hidden), change * change)
