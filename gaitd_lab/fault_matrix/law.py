"""What must happen in a cell: the law of a fault, and the laws that several faults share.

A law states what must happen where both drives are enabled; where one axis is enabled alone it is
the same for that axis. Where nothing is enabled there is nothing to stop: it states the mode that
follows (`Resting`). In STOPPING and FAULT the machine stays stopped, whatever comes.
"""

from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

from gaitd_names import Cause, ExitCode, Mode, StopCategory

S0, S1, S2 = StopCategory.S0, StopCategory.S1, StopCategory.S2
LOST: Final = (
    Cause.DRIVE_SILENT,
    Cause.HEARTBEAT_LOST,
    Cause.DRIVE_REBOOTED,
    Cause.DRIVE_NOT_OPERATIONAL,
)
AT_ONCE: Final = 2.0
"""Cycles: in the window of the fault, or the next."""
SILENCE: Final = 6.0
"""Three samples may be missing, the fourth causes a stop."""


class Resting(Enum):
    """Reaction of a machine whose drives are not enabled."""

    UNTOUCHED = "stays as it is"
    LOST = "off, looked for again and brought up, and nothing enabled"
    FAULTY = "fault, until a reset"
    EITHER = "as it is, off or fault: what was under way decides"


@dataclass(frozen=True, slots=True)
class Law:
    """Expected result of one cell."""

    stops: bool = False
    causes: frozenset[Cause] = frozenset()
    """Allowed first causes; the causes that follow may also be in `later`."""
    categories: frozenset[StopCategory] = frozenset()
    """Category of the first cause."""
    later: frozenset[Cause] = frozenset()
    latches: frozenset[Cause] = frozenset()
    """Final causes, if the first symptom may be another one: one of these is latched in the end."""
    within_cycles: float | None = None
    """Cycles until the frame that stops the last axis; None: it must stop, without a bound."""
    by_drives: bool = False
    """Nothing can be sent: the drives stop by themselves, within DETECTION_CYCLES. With a second
    fault that is so much later, and one drive may stop by itself before the other one does.
    """
    pushed: bool = False
    """A patient pushes harder than a drive can hold, so its stop may escalate to no power. Where a
    drive has lost its power, the leg need not rest, and THROWN_HIP_DEG and THROWN_SLIDE_MM hold in
    place of the stops' deflection, which assumes the speed limit: a leg without power is thrown
    faster than that (seen: 5 m/s).
    """
    runs_away: bool = False
    """The encoder that the drive's own fault reaction brakes by is wrong, so it pushes with all its
    force for as long as the reaction lasts. CiA 402 has no controlword for a drive in that state.
    The drive of the other axis is overpowered, its speed leaves its ramp, and its stop escalates to
    no power as for any drive that does not brake. Where both drives have lost their power,
    THROWN_HIP_DEG and THROWN_SLIDE_MM hold in place of the stops' deflection.
    """
    unreachable: bool = False
    """A drive whose motor or encoder is reversed receives no command any more, and its own stop
    drives the joint on with all its force. No software reaches it, only the emergency stop: the leg
    need not rest, and THROWN_HIP_DEG and THROWN_SLIDE_MM hold in place of the stops' deflection.
    """
    may_go_on: bool = False
    """True if the fault may be undetectable in this cell; it must stop if it is detected."""
    resting: Resting = Resting.UNTOUCHED
    ends_in: frozenset[Mode] = frozenset()
    """Modes that may follow, where the service does not stay in its mode."""
    exit_code: int | None = None
    why: str = ""
    """Reason why the law differs from the row's."""


DETECTION_CYCLES: Final = 14.0
"""Heartbeat time of the drives: 100 ms, and the frames under way."""


def goes_on(why: str = "", resting: Resting = Resting.UNTOUCHED) -> Law:
    """Law: nothing stops."""
    return Law(why=why, resting=resting)


def stops(
    *causes: Cause,
    by: tuple[StopCategory, ...] = (S1,),
    within: float | None = None,
    resting: Resting = Resting.UNTOUCHED,
    later: tuple[Cause, ...] = (),
) -> Law:
    """Law: both axes stop, for one of these causes."""
    return Law(
        stops=True,
        causes=frozenset(causes),
        categories=frozenset(by),
        later=frozenset(later),
        within_cycles=within,
        resting=resting,
    )


SILENT: Final = stops(
    *LOST, within=SILENCE, resting=Resting.LOST, later=(Cause.EMERGENCY, Cause.DRIVE_FAULT)
)
ALARM: Final = stops(Cause.EMERGENCY, Cause.DRIVE_FAULT, within=AT_ONCE, resting=Resting.FAULTY)
STUCK: Final = stops(
    Cause.ENCODER_FROZEN,
    Cause.TRACKING_LIMIT,
    Cause.SIGN_WRONG,
    Cause.EFFORT_DEVIATION,
    Cause.DRIVE_FAULT,
    Cause.EMERGENCY,
    by=(S0, S1, S2),
    within=60.0,
    later=(Cause.STOP_NOT_OBEYED, Cause.OBSERVER_INVALID),
)
_DOUBTFUL: Final = frozenset({Cause.SIGN_WRONG, Cause.ENCODER_JUMP, Cause.ENCODER_FROZEN})
WIRED: Final = replace(
    stops(
        *_DOUBTFUL,
        Cause.STOPPING_PATH,
        Cause.TRACKING_LIMIT,
        Cause.POSITION_LIMIT,
        Cause.VELOCITY_LIMIT,
        Cause.SPASM,
        Cause.EFFORT_DEVIATION,
        by=(S0, S1, S2),
        within=75.0,
        later=(
            Cause.STOP_NOT_OBEYED,
            Cause.DRIVE_FAULT,
            Cause.EMERGENCY,
            Cause.SINGULARITY,
            Cause.LIMIT_SWITCH,
        ),
    ),
    latches=_DOUBTFUL | {Cause.STOP_NOT_OBEYED},
    runs_away=True,
)
"""The first symptom may be a leg that moves the wrong way, towards a limit; the cause latched in
the end is implausible feedback, or a drive that did not obey. Over the phases of a gait it shows
after 4 to 71 cycles: latest just before a stride's end, where the hip's torque is small.
"""
JUMP: Final = stops(Cause.ENCODER_JUMP, Cause.UNREFERENCED, by=(S0,), within=AT_ONCE)
PUSHED: Final = stops(
    Cause.POSITION_LIMIT,
    Cause.STOPPING_PATH,
    Cause.TRACKING_LIMIT,
    Cause.VELOCITY_LIMIT,
    Cause.POWER_LIMIT,
    Cause.EFFORT_LIMIT,
    Cause.SPASM,
    Cause.SINGULARITY,
    Cause.LIMIT_SWITCH,
    Cause.EFFORT_DEVIATION,
    Cause.SIGN_WRONG,
    Cause.MOVED_AGAINST_DRIVE,
    Cause.DRIVE_FAULT,
    Cause.EMERGENCY,
    by=(S0, S1, S2),
    within=150.0,
    later=(Cause.STOP_NOT_OBEYED, Cause.ENCODER_FROZEN, Cause.ENCODER_JUMP),
)
NOT_FINITE: Final = stops(Cause.COMMAND_NOT_FINITE, within=AT_ONCE)
DOUBTFUL_NUMBER: Final = stops(
    Cause.ENCODER_JUMP,
    Cause.COMMAND_NOT_FINITE,
    by=(S0, S1),
    within=AT_ONCE,
    resting=Resting.FAULTY,  # the target follows the joint without power too, and is checked
)
NO_GATEWAY: Final = stops(Cause.GATEWAY_SILENT, by=(S2,), within=33.0)
DRIVES_ALONE: Final = replace(
    stops(
        *LOST,
        Cause.BUS_OFF,
        Cause.BUS_DOWN,
        Cause.LAST_END_UNKNOWN,
        Cause.TRANSMIT_QUEUE_FULL,
        Cause.EMERGENCY,
        Cause.DRIVE_FAULT,
        Cause.CYCLE_OVERRUN,
        later=(Cause.STOP_NOT_OBEYED,),
    ),
    by_drives=True,
)
"""Nothing reaches the drives: they detect it, and each of them stops itself."""
CORE_BUG: Final = replace(
    stops(
        Cause.DRIVE_FAULT,
        Cause.EMERGENCY,
        Cause.DRIVE_POWERED,
        Cause.LAST_END_UNKNOWN,
        *LOST,
        within=AT_ONCE,
        resting=Resting.EITHER,
    ),
    exit_code=ExitCode.UNAVAILABLE,
)
ENCODER_ERROR: Final = replace(
    stops(Cause.UNREFERENCED, by=(S0,), within=AT_ONCE, resting=Resting.FAULTY),
    later=frozenset({Cause.EMERGENCY, Cause.DRIVE_FAULT}),
    why="an encoder in error: its axis does not know its position any more",
)
