"""Expected result of each fault: a law for each row; exceptions are listed with their reason.

A row states what must happen where both drives are enabled; where one axis is enabled alone it is
the same for that axis. Where nothing is enabled there is nothing to stop: the row states the mode
that follows (`Resting`). In STOPPING and FAULT the machine stays stopped, whatever comes.

`exceptions.py` has the cells that differ from their row.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from types import MappingProxyType
from typing import Final

from daemon.core.runtime.loop_settings import ExitCode
from daemon.ipc.record import Cause, Mode, StopCategory

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
    """Nothing can be sent: the drives stop by themselves, within DETECTION_CYCLES."""
    delay_cycles: float = 0.0
    """Time from the first fault of a pair to the second, by which the drives may stop later."""
    may_part: bool = False
    """One drive may stop by itself, by one fault of a pair, before the other one does."""
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


_SILENT: Final = stops(
    *LOST, within=SILENCE, resting=Resting.LOST, later=(Cause.EMERGENCY, Cause.DRIVE_FAULT)
)
_EMERGENCY: Final = stops(
    Cause.EMERGENCY, Cause.DRIVE_FAULT, within=AT_ONCE, resting=Resting.FAULTY
)
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
_WIRED: Final = replace(
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
_JUMP: Final = stops(Cause.ENCODER_JUMP, Cause.UNREFERENCED, by=(S0,), within=AT_ONCE)
_PUSHED: Final = stops(
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
_NOT_FINITE: Final = stops(Cause.COMMAND_NOT_FINITE, within=AT_ONCE)
_DOUBTFUL_NUMBER: Final = stops(
    Cause.ENCODER_JUMP,
    Cause.COMMAND_NOT_FINITE,
    by=(S0, S1),
    within=AT_ONCE,
    resting=Resting.FAULTY,  # the target follows the joint without power too, and is checked
)
_GATEWAY: Final = stops(Cause.GATEWAY_SILENT, by=(S2,), within=33.0)
_ALONE: Final = replace(
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
_BUG: Final = replace(
    stops(
        Cause.DRIVE_FAULT,
        Cause.EMERGENCY,
        Cause.DRIVE_POWERED,
        Cause.LAST_END_UNKNOWN,
        *LOST,
        within=AT_ONCE,
        resting=Resting.EITHER,
    ),
    exit_code=ExitCode.BUG,
)
_EMCY_NAMES: Final = tuple(
    f"emcy_{one}xxx_{how}" for one in "123456789f" for how in ("fault", "told")
)

ROWS: Final[Mapping[str, Law]] = MappingProxyType(
    {
        "none": goes_on(),
        "silent": _SILENT,
        "unplugged": _SILENT,
        "deaf": _SILENT,
        "tpdo_lost_once": goes_on("up to three samples in a row are predicted over"),
        "tpdo_lost": _SILENT,
        "tpdo_ones": stops(Cause.INPUTS_IMPOSSIBLE, within=AT_ONCE, resting=Resting.FAULTY),
        "position_offset": goes_on("cyclic torque does not use it, and bring-up clears it"),
        "tpdo_late_2ms": goes_on("they come inside the window"),
        "tpdo_late_6ms": _SILENT,
        "rebooted": _SILENT,
        "drive_bus_off": replace(_SILENT, resting=Resting.EITHER),
        "drive_error_passive": _EMERGENCY,
        **dict.fromkeys(_EMCY_NAMES, _EMERGENCY),
        **{
            f"emcy_7xxx_{how}": replace(
                stops(Cause.UNREFERENCED, by=(S0,), within=AT_ONCE, resting=Resting.FAULTY),
                later=frozenset({Cause.EMERGENCY, Cause.DRIVE_FAULT}),
                why="an encoder in error: its axis does not know its position any more",
            )
            for how in ("fault", "told")
        },
        "emcy_warning": goes_on("its maker calls it a warning: told, and no stop"),
        "our_bus_off": replace(_ALONE, causes=frozenset({Cause.BUS_OFF}), resting=Resting.FAULTY),
        "our_error_passive": goes_on("told; frames still get through"),
        "our_overflow": goes_on("counted and told; what was lost shows as a missing sample"),
        "queue_full": replace(
            _ALONE,
            causes=frozenset({Cause.TRANSMIT_QUEUE_FULL, *LOST}),
            later=frozenset({Cause.BUS_DOWN, Cause.DRIVE_FAULT, Cause.EMERGENCY}),
            resting=Resting.EITHER,
        ),
        "queue_full_once": goes_on("one command is lost, the next one is in time"),
        "adapter_gone": replace(
            _ALONE,
            causes=frozenset({Cause.BUS_DOWN}),
            later=frozenset({Cause.DRIVE_FAULT, *LOST}),
            resting=Resting.EITHER,
        ),
        "sync_late_2ms": goes_on("the answers still come inside the window"),
        "sync_late_6ms": _SILENT,
        "encoder_frozen": replace(
            STUCK,
            later=STUCK.later | {Cause.ENCODER_JUMP},
            runs_away=True,
            why="the end of the fault is a jump, where the joint was moved meanwhile",
        ),
        "encoder_jump": _JUMP,
        "encoder_jump_once": _JUMP,
        "encoder_reversed": _WIRED,
        "wrong_sign": _WIRED,
        "torque_offset": replace(
            stops(
                Cause.EFFORT_DEVIATION,
                Cause.STATIC_LOAD_WRONG,
                *_PUSHED.causes,
                by=(S1, S2),
                resting=Resting.EITHER,
                later=tuple(_PUSHED.later),
            ),
            may_go_on=True,
            why="the drive regulates what its sensor shows: at once it cannot be told from a"
            " patient's effort; it shows without power, at the next enable, or over a stride",
        ),
        "blocked_rotor": STUCK,
        "brake_stuck": STUCK,
        "end_stop": replace(_PUSHED, pushed=True),
        "voluntary_push": goes_on("an effort that rises in 0.3 s is meant"),
        "spasm": _PUSHED,
        "limit_switch": stops(Cause.LIMIT_SWITCH, within=AT_ONCE),
        "hand_switch": stops(Cause.HAND_SWITCH_OPEN, within=AT_ONCE),
        "sto": stops(
            Cause.STO_ACTIVE,
            Cause.EMERGENCY,
            by=(S0, S1),
            within=AT_ONCE,
            resting=Resting.FAULTY,
            later=(Cause.DRIVE_FAULT,),
        ),
        "deaf_to_quick_stop": stops(
            Cause.HAND_SWITCH_OPEN, within=AT_ONCE, later=(Cause.STOP_NOT_OBEYED,)
        ),
        "observer_diverged": goes_on("it sees so itself, shows nothing, and begins anew in time"),
        "observer_nan": goes_on("it sees so itself, shows nothing, and begins anew in time"),
        "observer_nan_stays": stops(Cause.OBSERVER_INVALID, by=(S2,), within=60.0),
        "nan_setpoint": goes_on("refused and counted"),
        "nan_guidance": _NOT_FINITE,
        "nan_position": _DOUBTFUL_NUMBER,
        "nan_effort": stops(
            Cause.EFFORT_DEVIATION,
            Cause.EFFORT_LIMIT,
            Cause.COMMAND_NOT_FINITE,
            within=AT_ONCE,
        ),
        "utc_forth": goes_on("no decision is made by the wall clock"),
        "utc_back": goes_on("no decision is made by the wall clock"),
        "suspended": replace(_ALONE, resting=Resting.EITHER),
        "overrun_1": goes_on("below the count that stops"),
        "overrun_3": goes_on("below the count that stops"),
        "overrun_6": stops(Cause.CYCLE_OVERRUN, within=9.0),
        "zenoh_lost": goes_on("no client asks for anything; the gateway lives"),
        "gateway_dead": _GATEWAY,
        "gateway_35ms": goes_on("below the 300 ms that stop"),
        "gateway_200ms": goes_on("below the 300 ms that stop"),
        "gateway_2s": _GATEWAY,
        "gateway_floods": goes_on("all levels of a turn are drained, the newest counts"),
        "gateway_restarted": goes_on("a count that begins anew is no increase"),
        "foreign_gateway_state": goes_on("another core's request is void"),
        "only_foreign": _GATEWAY,
        "stop_count_down": replace(
            stops(Cause.STOP_REQUESTED, by=(S2,), within=60.0),
            why="down is no stop; the way up again is: any increase stops",
        ),
        "core_35ms": goes_on("below the count that stops, and below what the drives wait for"),
        "core_2s": replace(_ALONE, resting=Resting.EITHER),
        "core_sigterm": replace(
            stops(Cause.SHUTDOWN, within=3.0, resting=Resting.EITHER), exit_code=ExitCode.ENDED
        ),
        "core_sigkill": replace(_ALONE, resting=Resting.EITHER, exit_code=-9),
        "out_of_memory": _BUG,
        "notebook_full": _BUG,
        "ring_full": _BUG,
    }
)
