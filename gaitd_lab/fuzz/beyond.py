"""How far a joint may be out.

Beyond the limit is allowed where no drive could have held the joint: a drive of the leg was without
its power stage within BEFORE_S (springs and gravity move the leg), the patient pushes outwards, or
a fault made the drive see or push wrongly within BEFORE_S (BLINDING). A stop that begins inside is
no excuse: `gaitd check` has swept its path.
Where the joint was led by such a thing it may stay: a drive that stopped there holds it there, long
after the patient pushes no more. Only a margin farther out is judged anew.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Final

from gaitd_lab.fuzz.watched import WatchedDrive
from sim_drives.plant.truth import Truth
from sim_drives.settings import FaultKind

LIMIT_MARGIN: Final = (math.radians(0.5), 0.003)
"""rad, m: the path from noticing to the ramp, at what speed is left there."""
BEFORE_S: Final = 3.0
PUSH_FLOOR: Final = (1.0, 10.0)
"""N·m, N: less is no push."""
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
"""Faults after which a drive sees wrongly, pushes wrongly, or does not do what it shows."""


def beyond_limit(
    drive: WatchedDrive, of_leg: Sequence[WatchedDrive], truth: Truth, now_ns: int
) -> Iterator[tuple[str, str]]:
    """Where this joint really is, and whether something excuses it.

    Args:
        drive: of the joint; remembers how far out it was led.
        of_leg: all drives of its leg.
        truth: of the leg.
        now_ns: time of the truth.
    """
    rules = drive.rules
    at = truth.position[rules.axis]
    beyond = max(rules.low_si - at, at - rules.high_si)
    margin = LIMIT_MARGIN[rules.axis]
    if beyond <= margin:
        drive.led_beyond_si = 0.0
        return
    outwards = 1.0 if at > rules.high_si else -1.0
    pushed = truth.patient[rules.axis] * outwards > PUSH_FLOOR[rules.axis]
    before_ns = round(BEFORE_S * 1_000_000_000)
    free = any(now_ns - other.unpowered_ns < before_ns for other in of_leg)
    blind = any(now_ns - other.blinded_ns < before_ns for other in of_leg)
    if pushed or free or blind:
        drive.led_beyond_si = max(drive.led_beyond_si, beyond)
    elif drive.led_beyond_si == 0.0 or beyond > drive.led_beyond_si + margin:
        what = f"{rules.name} at {at:.4g}, limits {rules.low_si:.4g} to {rules.high_si:.4g}"
        yield "beyond the limit", what
