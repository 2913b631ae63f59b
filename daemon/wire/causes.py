"""Stop categories of causes, where the design fixes them; the texts are in `gaitd_texts`.

All other categories are given by `limits.toml`. Doubtful feedback of an axis is S0 for that axis
and S1 for the other, because an axis must never hold by an encoder that cannot be trusted; the
table `FIXED_CATEGORY` holds the category for the axis of the cause.
"""

from typing import Final

from gaitd_names import Cause, StopCategory

FIXED_CATEGORY: Final[dict[Cause, StopCategory]] = {
    Cause.ENCODER_FROZEN: StopCategory.S0,
    Cause.ENCODER_JUMP: StopCategory.S0,
    Cause.UNREFERENCED: StopCategory.S0,
    Cause.SIGN_WRONG: StopCategory.S0,
    Cause.MOVED_AGAINST_DRIVE: StopCategory.S1,
    Cause.DRIVE_SILENT: StopCategory.S1,
    Cause.HEARTBEAT_LOST: StopCategory.S1,
    Cause.DRIVE_REBOOTED: StopCategory.S1,
    Cause.DRIVE_NOT_OPERATIONAL: StopCategory.S1,
    Cause.HAND_SWITCH_OPEN: StopCategory.S1,
    Cause.SHUTDOWN: StopCategory.S1,
    Cause.STO_ACTIVE: StopCategory.S0,
    Cause.INPUTS_IMPOSSIBLE: StopCategory.S1,
    Cause.BUS_DOWN: StopCategory.S1,
    Cause.BUS_OFF: StopCategory.S1,
    Cause.UNEXPECTED_ENABLE: StopCategory.S0,
    Cause.COMMAND_NOT_FINITE: StopCategory.S1,
    Cause.LAST_END_UNKNOWN: StopCategory.S1,
    Cause.STOP_NOT_OBEYED: StopCategory.S0,
}
"""Categories fixed by the design: a file cannot choose them."""

DOUBTFUL_FEEDBACK: Final = frozenset(
    {Cause.ENCODER_FROZEN, Cause.ENCODER_JUMP, Cause.UNREFERENCED, Cause.SIGN_WRONG}
)
"""S0 for the axis of the cause, S1 for all others."""

LOST_DRIVE: Final = frozenset(
    {Cause.DRIVE_SILENT, Cause.HEARTBEAT_LOST, Cause.DRIVE_REBOOTED, Cause.DRIVE_NOT_OPERATIONAL}
)
"""NMT stop to the drive of the cause, S1 for all others; reset brings it up anew."""

CHOSEN_CATEGORY: Final = tuple(
    cause
    for cause in Cause
    if cause not in FIXED_CATEGORY
    and cause
    not in {
        Cause.NONE,
        Cause.BRING_UP_FAILED,
        Cause.DRIVE_POWERED,
        Cause.STATIC_LOAD_WRONG,
        Cause.SELF_TEST_FAILED,
    }
)
"""Causes whose category `limits.toml` must give; the rest is fixed or never stops a motion."""
