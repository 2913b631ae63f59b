"""The table of the matrix: each fault, how it begins, how long it lasts, and what is right.

Cells that differ from their row are in `exceptions.py`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain
from types import MappingProxyType
from typing import Final, NamedTuple

from gaitd_names import Cause, ExitCode

from gaitd_lab.fault_matrix import core_kinds, kinds
from gaitd_lab.fault_matrix.kinds import LASTS_S, MS, NAN, Fault, FaultAction
from gaitd_lab.fault_matrix.law import (
    ALARM,
    AT_ONCE,
    CORE_BUG,
    DOUBTFUL_NUMBER,
    DRIVES_ALONE,
    ENCODER_ERROR,
    JUMP,
    LOST,
    NO_GATEWAY,
    NOT_FINITE,
    PUSHED,
    S0,
    S1,
    S2,
    SILENT,
    STUCK,
    WIRED,
    Law,
    Resting,
    goes_on,
    stops,
)

HOUR_NS: Final = 3_600_000 * MS


class Row(NamedTuple):
    """A row of the table."""

    fault: Fault
    law: Law
    """What is right where `exceptions.py` has nothing else."""


def _drive(name: str, text: str, words: str, law: Law, lasts_s: float = LASTS_S) -> Row:
    """A fault of one virtual drive, by its command."""
    return Row(Fault(name, text, kinds.machine(words), lasts_s=lasts_s), law)


def _axis(name: str, text: str, play: FaultAction, law: Law) -> Row:
    """A fault of an axis."""
    return Row(Fault(name, text, play), law)


def _whole(name: str, text: str, play: FaultAction, law: Law, lasts_s: float = LASTS_S) -> Row:
    """A fault that belongs to no axis."""
    return Row(Fault(name, text, play, of_an_axis=False, lasts_s=lasts_s), law)


_DRIVE: Final = (
    _drive("silent", "nothing of the drive reaches the bus", "silent {}", SILENT),
    _drive("unplugged", "the drive is cut off from the bus, both ways", "unplugged {}", SILENT),
    _drive("deaf", "the drive hears nothing, and still sends", "deaf {}", SILENT),
    _drive(
        "tpdo_lost_once",
        "the TPDOs of one SYNC are lost",
        "lost_tpdo {} 0.010",
        goes_on("up to three samples in a row are predicted over"),
        lasts_s=0.01,
    ),
    _drive(
        "tpdo_lost",
        "one of the two cyclic TPDOs does not come any more",
        "lost_tpdo {} - 2",
        SILENT,
    ),
    _drive(
        "tpdo_ones",
        "every byte of the TPDO with effort and inputs is FFh",
        "tpdo_all_ones {} - 2",
        stops(Cause.INPUTS_IMPOSSIBLE, within=AT_ONCE, resting=Resting.FAULTY),
    ),
    _drive(
        "tpdo_late_2ms",
        "TPDOs come 2 ms later, inside the window",
        "late_tpdo {} - 2",
        goes_on("they come inside the window"),
    ),
    _drive("tpdo_late_6ms", "TPDOs come 6 ms later, after the window", "late_tpdo {} - 6", SILENT),
    _drive(
        "rebooted",
        "the drive loses its power for a moment and boots",
        "reboot {}",
        SILENT,
        lasts_s=0.01,
    ),
    _drive(
        "drive_bus_off",
        "the drive's CAN controller goes bus-off",
        "bus_off {}",
        replace(SILENT, resting=Resting.EITHER),
    ),
    _drive(
        "drive_error_passive",
        "the drive's CAN controller is error-passive",
        "bus_passive {}",
        ALARM,
    ),
)

EMERGENCY_LASTS_S: Final = 0.6
EMERGENCIES: Final[Mapping[int, tuple[int, str]]] = MappingProxyType(
    {
        0x1: (0x1000, "generic error"),
        0x2: (0x2310, "overcurrent"),
        0x3: (0x3210, "overvoltage"),
        0x4: (0x4210, "power stage too hot"),
        0x5: (0x5280, "hardware defect"),
        0x6: (0x6320, "software parameter"),
        0x7: (0x7320, "position sensor"),
        0x8: (0x8611, "following error"),
        0x9: (0x9000, "external error"),
        0xF: (0xFF0B, "system peak overloaded"),
    }
)
"""One code of each error class of CiA 301 (table of 7.2.7.1), with its meaning on an EPOS4."""
ENCODER_CLASS: Final = 0x7
WARNING_CODE: Final = 0xFF01
"""The only code that an EPOS4 sends without stopping: system overloaded."""


def _emergency(name: str, text: str, words: str, law: Law) -> Row:
    return _drive(name, text, words, law, EMERGENCY_LASTS_S)


def _emergencies() -> Iterator[Row]:
    """Return two rows for each class: a message and a fault, and the message alone."""
    for error_class, (code, meaning) in EMERGENCIES.items():
        name, text = f"emcy_{error_class:x}xxx", f"EMCY {code:04X}h ({meaning}), and the drive goes"
        law = ENCODER_ERROR if error_class == ENCODER_CLASS else ALARM
        yield _emergency(f"{name}_fault", f"{text} into fault", f"emcy {{}} - {code:#06x}", law)
        told = f"emcy_warning {{}} - {code:#06x}"
        yield _emergency(f"{name}_told", f"{text} on as before", told, law)
    yield _emergency(
        "emcy_warning",
        f"EMCY {WARNING_CODE:04X}h, which its maker calls a warning",
        f"emcy_warning {{}} - {WARNING_CODE:#06x}",
        goes_on("its maker calls it a warning: told, and no stop"),
    )


_BUS: Final = (
    _whole(
        "our_bus_off",
        "our CAN controller goes bus-off",
        kinds.our_bus_off(),
        replace(DRIVES_ALONE, causes=frozenset({Cause.BUS_OFF}), resting=Resting.FAULTY),
    ),
    _whole(
        "our_error_passive",
        "our CAN controller is error-passive",
        kinds.reported(kinds.PASSIVE, kinds.ACTIVE),
        goes_on("told; frames still get through"),
    ),
    _whole(
        "our_overflow",
        "our CAN controller has lost a frame",
        kinds.reported(kinds.OVERFLOW),
        goes_on("counted and told; what was lost shows as a missing sample"),
    ),
    _whole(
        "queue_full",
        "nothing can be placed in the transmit queue",
        kinds.queue_full(),
        replace(
            DRIVES_ALONE,
            causes=frozenset({Cause.TRANSMIT_QUEUE_FULL, *LOST}),
            later=frozenset({Cause.BUS_DOWN, Cause.DRIVE_FAULT, Cause.EMERGENCY}),
            resting=Resting.EITHER,
        ),
    ),
    _whole(
        "queue_full_once",
        "the transmit queue is full for one cycle",
        kinds.queue_full(),
        goes_on("one command is lost, the next one is in time"),
        lasts_s=0.01,
    ),
    _whole(
        "adapter_gone",
        "the CAN interface is pulled out",
        kinds.adapter_gone(),
        replace(
            DRIVES_ALONE,
            causes=frozenset({Cause.BUS_DOWN}),
            later=frozenset({Cause.DRIVE_FAULT, *LOST}),
            resting=Resting.EITHER,
        ),
    ),
    _whole(
        "sync_late_2ms",
        "each SYNC waits 2 ms for the wire",
        kinds.sync_waits(2),
        goes_on("the answers still come inside the window"),
    ),
    _whole("sync_late_6ms", "each SYNC waits 6 ms for the wire", kinds.sync_waits(6), SILENT),
)

_SENSORS: Final = (
    _drive(
        "encoder_frozen",
        "the reported position does not change",
        "frozen_encoder {}",
        replace(
            STUCK,
            later=STUCK.later | {Cause.ENCODER_JUMP},
            runs_away=True,
            why="the end of the fault is a jump, where the joint was moved meanwhile",
        ),
    ),
    _drive(
        "encoder_jump",
        "the position that is reported is 4000 counts off",
        "encoder_glitch {} - 4000",
        JUMP,
    ),
    _drive(
        "encoder_jump_once",
        "one sample is 4000 counts off",
        "encoder_glitch {} 0.010 4000",
        JUMP,
        lasts_s=0.01,
    ),
    _drive("encoder_reversed", "the encoder counts the wrong way", "encoder_reversed {}", WIRED),
    _drive("wrong_sign", "the motor turns the wrong way", "wrong_sign {}", WIRED),
    _drive(
        "torque_offset",
        "the current sensor shows 3 A too much",
        "torque_offset {} - 3000",
        replace(
            stops(
                Cause.EFFORT_DEVIATION,
                Cause.STATIC_LOAD_WRONG,
                *PUSHED.causes,
                by=(S1, S2),
                resting=Resting.EITHER,
                later=tuple(PUSHED.later),
            ),
            may_go_on=True,
            why="the drive regulates what its sensor shows: at once it cannot be told from a"
            " patient's effort; it shows without power, at the next enable, or over a stride",
        ),
    ),
)

_LEFTOVERS: Final = (
    _axis(
        "position_offset",
        "2000 counts in 60B0h, the position offset",
        kinds.left_in(0x60B0, 2000),
        goes_on("cyclic torque does not use it, and bring-up clears it"),
    ),
)

_MECHANICS: Final = (
    _drive("blocked_rotor", "the joint is jammed", "blocked_rotor {}", STUCK),
    _drive("brake_stuck", "the brake has closed and does not open", "brake_stuck {}", STUCK),
    _axis(
        "end_stop",
        "the patient pushes the joint into its stop",
        kinds.patient("into_{}_stop"),
        replace(PUSHED, pushed=True),
    ),
    _whole(
        "voluntary_push",
        "the patient pushes at a leg that stands, 10 N m and 60 N within 0.3 s",
        kinds.patient("pushes"),
        goes_on("an effort that rises in 0.3 s is meant"),
        lasts_s=6.2,
    ),
    _whole(
        "spasm",
        "the patient contracts hard against the motion",
        kinds.patient("spasm"),
        PUSHED,
        lasts_s=2.2,
    ),
    _axis(
        "limit_switch",
        "the limit switch ahead of the joint closes",
        kinds.limit_switch_ahead(),
        stops(Cause.LIMIT_SWITCH, within=AT_ONCE),
    ),
    _drive(
        "hand_switch",
        "the patient releases the hand switch",
        "hand_switch_open {}",
        stops(Cause.HAND_SWITCH_OPEN, within=AT_ONCE),
    ),
    _drive(
        "sto",
        "safe torque off",
        "sto_open {}",
        stops(
            Cause.STO_ACTIVE,
            Cause.EMERGENCY,
            by=(S0, S1),
            within=AT_ONCE,
            resting=Resting.FAULTY,
            later=(Cause.DRIVE_FAULT,),
        ),
    ),
    _axis(
        "deaf_to_quick_stop",
        "the drive shows quick stop, goes on as before, and the hand switch is let go",
        kinds.machine("ignores_quick_stop {}", "hand_switch_open {}"),
        stops(Cause.HAND_SWITCH_OPEN, within=AT_ONCE, later=(Cause.STOP_NOT_OBEYED,)),
    ),
)

_NUMBERS: Final = (
    _whole(
        "observer_diverged",
        "the observer's state is far from anything",
        core_kinds.observer_state(1e4),
        goes_on("it sees so itself, shows nothing, and begins anew in time"),
    ),
    _whole(
        "observer_nan",
        "the observer's state is no number",
        core_kinds.observer_state(kinds.NAN),
        goes_on("it sees so itself, shows nothing, and begins anew in time"),
    ),
    _whole(
        "observer_nan_stays",
        "the observer's state is no number, again and again",
        core_kinds.observer_lost(),
        stops(Cause.OBSERVER_INVALID, by=(S2,), within=60.0),
    ),
    _whole(
        "nan_setpoint",
        "a controller's setpoints are no numbers",
        kinds.levels(kinds.nan_setpoint),
        goes_on("refused and counted"),
    ),
    _axis(
        "nan_guidance",
        "where the plan wants the axis is no number",
        core_kinds.nan_in_guidance(),
        NOT_FINITE,
    ),
    _axis(
        "nan_position",
        "the position scaled from the drive's is no number",
        core_kinds.wrong_scaling(lambda scaling: scaling._replace(offset_si=NAN)),
        DOUBTFUL_NUMBER,
    ),
    _axis(
        "nan_effort",
        "the effort scaled from the drive's is no number",
        core_kinds.wrong_scaling(lambda scaling: scaling._replace(effort_per_torque_count_si=NAN)),
        stops(Cause.EFFORT_DEVIATION, Cause.EFFORT_LIMIT, Cause.COMMAND_NOT_FINITE, within=AT_ONCE),
    ),
)

_TIME: Final = (
    _whole(
        "utc_forth",
        "the wall clock is set an hour forth",
        kinds.clock_set(HOUR_NS),
        goes_on("no decision is made by the wall clock"),
    ),
    _whole(
        "utc_back",
        "the wall clock is set an hour back",
        kinds.clock_set(-HOUR_NS),
        goes_on("no decision is made by the wall clock"),
    ),
    _whole(
        "suspended",
        "the machine sleeps for 1 s, its monotonic clock with it",
        kinds.suspended(1000),
        replace(DRIVES_ALONE, resting=Resting.EITHER),
        lasts_s=1.0,
    ),
    _whole(
        "overrun_1",
        "the core is held up for 1 cycle",
        kinds.held(10),
        goes_on("below the count that stops"),
        lasts_s=0.01,
    ),
    _whole(
        "overrun_3",
        "the core is held up for 3 cycles",
        kinds.held(30),
        goes_on("below the count that stops"),
        lasts_s=0.03,
    ),
    _whole(
        "overrun_6",
        "the core is held up for 6 cycles",
        kinds.held(60),
        stops(Cause.CYCLE_OVERRUN, within=9.0),
        lasts_s=0.06,
    ),
)

_GATEWAY: Final = (
    _whole(
        "zenoh_lost",
        "the session of clients is lost: the gateway lives and has nothing to say",
        kinds.levels(kinds.no_requests),
        goes_on("no client asks for anything; the gateway lives"),
    ),
    _whole(
        "gateway_dead",
        "the gateway is dead (SIGTERM, SIGKILL), and comes back",
        kinds.gateway_silent(),
        NO_GATEWAY,
    ),
    _whole(
        "gateway_35ms",
        "the gateway stands still for 35 ms (SIGSTOP)",
        kinds.gateway_silent(),
        goes_on("below the 300 ms that stop"),
        lasts_s=0.035,
    ),
    _whole(
        "gateway_200ms",
        "the gateway stalls for 0.2 s",
        kinds.gateway_silent(),
        goes_on("below the 300 ms that stop"),
        lasts_s=0.2,
    ),
    _whole(
        "gateway_2s",
        "the gateway stands still for 2 s (SIGSTOP)",
        kinds.gateway_silent(),
        NO_GATEWAY,
        lasts_s=2.0,
    ),
    _whole(
        "gateway_floods",
        "the gateway sends 10 000 levels a second",
        kinds.levels(kinds.flood),
        goes_on("all levels of a turn are drained, the newest counts"),
    ),
    _whole(
        "gateway_restarted",
        "the gateway begins anew, all its counts from zero",
        kinds.levels(kinds.restarted),
        goes_on("a count that begins anew is no increase"),
    ),
    _whole(
        "foreign_gateway_state",
        "levels for another core, with a request to enable",
        kinds.levels(kinds.foreign),
        goes_on("another core's request is void"),
    ),
    _whole(
        "only_foreign",
        "nothing but levels for another core",
        kinds.levels(kinds.foreign_alone),
        NO_GATEWAY,
    ),
    _whole(
        "stop_count_down",
        "the count of stops goes down",
        kinds.levels(kinds.lower_stop_count),
        replace(
            stops(Cause.STOP_REQUESTED, by=(S2,), within=60.0),
            why="down is no stop; the way up again is: any increase stops",
        ),
        lasts_s=0.5,
    ),
)

_PROCESS: Final = (
    _whole(
        "core_35ms",
        "the core stands still for 35 ms (SIGSTOP)",
        kinds.held(35),
        goes_on("below the count that stops, and below what the drives wait for"),
        lasts_s=0.035,
    ),
    _whole(
        "core_2s",
        "the core stands still for 2 s (SIGSTOP)",
        kinds.held(2000),
        replace(DRIVES_ALONE, resting=Resting.EITHER),
        lasts_s=2.0,
    ),
    _whole(
        "core_sigterm",
        "the core is asked to end",
        kinds.terminated(),
        replace(stops(Cause.SHUTDOWN, within=3.0, resting=Resting.EITHER), exit_code=ExitCode.DONE),
    ),
    _whole(
        "core_sigkill",
        "the core is dead; a new one starts 1 s later",
        kinds.killed(),
        replace(DRIVES_ALONE, resting=Resting.EITHER, exit_code=-9),
        lasts_s=1.0,
    ),
    _whole(
        "out_of_memory",
        "an allocation in a cycle fails; a new core starts later",
        core_kinds.out_of_memory(),
        CORE_BUG,
        lasts_s=1.0,
    ),
    _whole(
        "notebook_full",
        "the notebook cannot be written (disk full)",
        core_kinds.notebook_full(),
        CORE_BUG,
        lasts_s=1.0,
    ),
    _whole(
        "ring_full",
        "the ring cannot be written (disk full)",
        core_kinds.ring_full(),
        CORE_BUG,
        lasts_s=1.0,
    ),
)

_NONE: Final = _whole(
    "none", "nothing: the column by itself", FaultAction(kinds.nothing, kinds.nothing), goes_on()
)

_FAMILIES: Final[Mapping[str, tuple[Row, ...]]] = MappingProxyType(
    {
        "drive": _DRIVE,
        "emergency": tuple(_emergencies()),
        "bus": _BUS,
        "sensor": (*_SENSORS, *_LEFTOVERS),
        "mechanics": _MECHANICS,
        "number": _NUMBERS,
        "time": _TIME,
        "gateway": _GATEWAY,
        "process": _PROCESS,
    }
)
_ROWS: Final = (_NONE, *chain.from_iterable(_FAMILIES.values()))
FAMILIES: Final = MappingProxyType(
    {family: tuple(row.fault.name for row in rows) for family, rows in _FAMILIES.items()}
)
"""Names of the faults by family."""
FAULTS: Final = MappingProxyType({fault.name: fault for fault, _ in _ROWS})
"""Faults by name, in the order of the page."""
LAWS: Final = MappingProxyType({fault.name: law for fault, law in _ROWS})
"""Laws of the rows by the name of their fault."""
