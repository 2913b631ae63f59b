"""The response of a joint to changes of its drive's effort: does it have the drive's sign?

Beyond the load, a joint obeys `motion = push + effort of the patient`: motion is inertia and
friction, push is the drive's effort. If push and motion have opposite signs, either motor or
encoder is the wrong way round, or a patient moves the leg against its drive, with at least the sum
of both. A size cannot tell the two apart. Changes can, whatever a slow effort of the patient is.

Rules, for the last SAMPLES cycles of one axis, from raw values only:
1.  If the drive's sign is right, the patient gives `motion - push`; if it is wrong,
    `motion + push`, or its negative. The wrong one of the two contains each change of the push
    twice. So their ratio of variances tells which is right: below RIGHT_MAX_RATIO the joint answers
    with its drive's sign, above UNCLEAR_MAX_RATIO it does not, between them nothing is shown.
2.  Where fewer cycles are known, the answer is that of a wrong sign.
3.  No patient's effort jumps by the limit of a sign mismatch within JUMP_CYCLES. If a sign reverses
    during a mismatch, or makes one at once, it jumps by at least twice that limit. So after a jump,
    or a number that is not finite, the answer is that of a wrong sign, whatever the others show.
4.  An answer with the drive's sign counts until the mismatch ends, or until a jump: by rule 3 no
    sign reverses meanwhile. The push of a drive may stand still then, and show nothing.

Measured where a mismatch first counts: with patients who give 1.4 of the need of a gait the ratio
was 0.08 or less. With the reversed motors and encoders of the fault matrix it was 0.88 or more, and
5 or more where no jump was within the window.
"""

import math
from typing import Final

SAMPLES: Final = 12
"""The guidance of a gait pushes back within this time. In a longer one, a patient's effort changes
as much as the push; in a shorter one, noise does."""
RIGHT_MAX_RATIO: Final = 0.25
UNCLEAR_MAX_RATIO: Final = 2.0
JUMP_CYCLES: Final = 2
"""A jump is complete after two cycles, because push and motion are means over two."""
WRONG: Final = math.inf
"""Ratio of variances where the answer is that of a wrong sign, whatever the samples show."""

Samples = tuple[tuple[float, float], ...]
"""Push and motion of each cycle, N·m or N, the newest last."""


def with_sample(samples: Samples, push_si: float, motion_si: float) -> Samples:
    """The last SAMPLES samples after one more."""
    return (*samples, (push_si, motion_si))[-SAMPLES:]


def updated(before_ratio: float, samples: Samples, jump_si: float) -> float:
    """The ratio of variances in a mismatch that counts; `WRONG` by rules 2 and 3.

    Args:
        before_ratio: the ratio of the cycle before, or `WRONG` where no mismatch counted.
        samples: those of this cycle and before it.
        jump_si: limit of a sign mismatch, N·m or N.
    """
    right_si = [motion_si - push_si for push_si, motion_si in samples]
    if not all(
        abs(now_si - before_si) <= jump_si
        for before_si, now_si in zip(right_si, right_si[JUMP_CYCLES:], strict=False)
    ):
        return WRONG
    if before_ratio < RIGHT_MAX_RATIO:
        return before_ratio
    wrong = _variance([motion_si + push_si for push_si, motion_si in samples])
    return WRONG if len(samples) < SAMPLES or wrong == 0.0 else _variance(right_si) / wrong


def _variance(values: list[float]) -> float:
    mean = sum(values) / len(values)
    return sum((value - mean) ** 2 for value in values) / len(values)
