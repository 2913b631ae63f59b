"""Allowed excess of a joint over its limit.

A joint may be beyond the limit where no drive could have held it: a drive of the leg was without
its power stage within BEFORE_S (springs and gravity move the leg), the patient pushes outwards, or
a fault made the drive measure or push wrongly within BEFORE_S (BLINDING). A stop that begins inside
the limit is no excuse: `gaitd check` has checked its path.
A joint moved out in this way may stay there: a drive that stopped there holds it, long after the
patient's push has ended. Only a position a further margin outside is checked again.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Final

from gaitd_lab.random_sessions.watched_drive import WatchedDrive
from sim_drives.plant.truth import Truth
from sim_drives.settings import FaultKind

LIMIT_MARGIN: Final = (math.radians(0.5), 0.003)
"""rad, m: the path from detection to the ramp, at the speed that remains there."""
BEFORE_S: Final = 3.0
PUSH_FLOOR: Final = (1.0, 10.0)
"""N·m, N: a smaller effort is no push."""
BLINDING: Final = frozenset(
    {
        FaultKind.FROZEN_ENCODER,
        FaultKind.ENCODER_GLITCH,
        FaultKind.ENCODER_REVERSED,
        FaultKind.WRONG_SIGN,
        FaultKind.TORQUE_OFFSET,
        FaultKind.IGNORES_QUICK_STOP,
        FaultKind.BLOCKED_ROTOR,
        FaultKind.BRAKE_STUCK,
    }
)
"""Faults after which a drive measures wrongly, pushes wrongly, or does not do what it shows."""


def outside_limit(
    drive: WatchedDrive, of_leg: Sequence[WatchedDrive], truth: Truth, now_ns: int
) -> Iterator[tuple[str, str]]:
    """Check the joint's true position; report it if it is outside without an excuse.

    Args:
        drive: drive of the joint; stores how far out the joint was moved.
        of_leg: all drives of its leg.
        truth: true state of the leg.
        now_ns: time of the truth.
    """
    rules = drive.rules
    at = truth.position[rules.axis]
    beyond = max(rules.low_si - at, at - rules.high_si)
    margin = LIMIT_MARGIN[rules.axis]
    if beyond <= margin:
        drive.led_outside_si = 0.0
        return
    outwards = 1.0 if at > rules.high_si else -1.0
    pushed = truth.patient[rules.axis] * outwards > PUSH_FLOOR[rules.axis]
    before_ns = round(BEFORE_S * 1_000_000_000)
    free = any(now_ns - other.unpowered_ns < before_ns for other in of_leg)
    blind = any(now_ns - other.blinded_ns < before_ns for other in of_leg)
    if pushed or free or blind:
        drive.led_outside_si = max(drive.led_outside_si, beyond)
    elif drive.led_outside_si == 0.0 or beyond > drive.led_outside_si + margin:
        what = f"{rules.name} at {at:.4g}, limits {rules.low_si:.4g} to {rules.high_si:.4g}"
        yield "beyond the limit", what
