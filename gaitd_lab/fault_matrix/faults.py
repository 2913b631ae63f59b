"""The rows of the matrix: each fault, what it does, how it begins and how long it lasts.

The expected results are in `expected.py`.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gaitd_lab.fault_matrix import core_kinds, kinds
from gaitd_lab.fault_matrix.emergencies import emergencies
from gaitd_lab.fault_matrix.kinds import LASTS_S, MS, Fault, FaultAction

HOUR_NS: Final = 3_600_000 * MS


def _drive(name: str, text: str, words: str, lasts_s: float = LASTS_S) -> Fault:
    """A fault of one virtual drive, by its command."""
    return Fault(name, text, kinds.machine(words), lasts_s=lasts_s)


def _whole(name: str, text: str, play: FaultAction, lasts_s: float = LASTS_S) -> Fault:
    """A fault that belongs to no axis."""
    return Fault(name, text, play, of_an_axis=False, lasts_s=lasts_s)


_DRIVE: Final = (
    _drive("silent", "nothing of the drive reaches the bus", "silent {}"),
    _drive("unplugged", "the drive is cut off from the bus, both ways", "unplugged {}"),
    _drive("deaf", "the drive hears nothing, and still sends", "deaf {}"),
    _drive("tpdo_lost_once", "the TPDOs of one SYNC are lost", "lost_tpdo {} 0.010", lasts_s=0.01),
    _drive("tpdo_lost", "one of the two cyclic TPDOs does not come any more", "lost_tpdo {} - 2"),
    _drive(
        "tpdo_ones", "every byte of the TPDO with effort and inputs is FFh", "tpdo_all_ones {} - 2"
    ),
    _drive("tpdo_late_2ms", "TPDOs come 2 ms later, inside the window", "late_tpdo {} - 2"),
    _drive("tpdo_late_6ms", "TPDOs come 6 ms later, after the window", "late_tpdo {} - 6"),
    _drive(
        "rebooted", "the drive loses its power for a moment and boots", "reboot {}", lasts_s=0.01
    ),
    _drive("drive_bus_off", "the drive's CAN controller goes bus-off", "bus_off {}"),
    _drive("drive_error_passive", "the drive's CAN controller is error-passive", "bus_passive {}"),
)

_BUS: Final = (
    _whole("our_bus_off", "our CAN controller goes bus-off", kinds.our_bus_off()),
    _whole(
        "our_error_passive",
        "our CAN controller is error-passive",
        kinds.reported(kinds.PASSIVE, kinds.ACTIVE),
    ),
    _whole("our_overflow", "our CAN controller has lost a frame", kinds.reported(kinds.OVERFLOW)),
    _whole("queue_full", "nothing can be placed in the transmit queue", kinds.queue_full()),
    _whole(
        "queue_full_once",
        "the transmit queue is full for one cycle",
        kinds.queue_full(),
        lasts_s=0.01,
    ),
    _whole("adapter_gone", "the CAN interface is pulled out", kinds.adapter_gone()),
    _whole("sync_late_2ms", "each SYNC waits 2 ms for the wire", kinds.sync_waits(2)),
    _whole("sync_late_6ms", "each SYNC waits 6 ms for the wire", kinds.sync_waits(6)),
)

_SENSORS: Final = (
    _drive("encoder_frozen", "the reported position does not change", "frozen_encoder {}"),
    _drive(
        "encoder_jump",
        "the position that is reported is 4000 counts off",
        "encoder_glitch {} - 4000",
    ),
    _drive(
        "encoder_jump_once",
        "one sample is 4000 counts off",
        "encoder_glitch {} 0.010 4000",
        lasts_s=0.01,
    ),
    _drive("encoder_reversed", "the encoder counts the wrong way", "encoder_reversed {}"),
    _drive("wrong_sign", "the motor turns the wrong way", "wrong_sign {}"),
    _drive("torque_offset", "the current sensor shows 3 A too much", "torque_offset {} - 3000"),
)

_LEFTOVERS: Final = (
    Fault(
        "position_offset", "2000 counts in 60B0h, the position offset", kinds.left_in(0x60B0, 2000)
    ),
)

_MECHANICS: Final = (
    _drive("blocked_rotor", "the joint is jammed", "blocked_rotor {}"),
    _drive("brake_stuck", "the brake has closed and does not open", "brake_stuck {}"),
    Fault("end_stop", "the patient pushes the joint into its stop", kinds.patient("into_{}_stop")),
    _whole(
        "voluntary_push",
        "the patient pushes at a leg that stands, 10 N m and 60 N within 0.3 s",
        kinds.patient("pushes"),
        lasts_s=6.2,
    ),
    _whole(
        "spasm",
        "the patient contracts hard against the motion",
        kinds.patient("spasm"),
        lasts_s=2.2,
    ),
    Fault("limit_switch", "the limit switch ahead of the joint closes", kinds.limit_switch_ahead()),
    _drive("hand_switch", "the patient releases the hand switch", "hand_switch_open {}"),
    _drive("sto", "safe torque off", "sto_open {}"),
    Fault(
        "deaf_to_quick_stop",
        "the drive shows quick stop, goes on as before, and the hand switch is let go",
        kinds.machine("ignores_quick_stop {}", "hand_switch_open {}"),
    ),
)

_NUMBERS: Final = (
    _whole(
        "observer_diverged",
        "the observer's state is far from anything",
        core_kinds.observer_state(1e4),
    ),
    _whole(
        "observer_nan", "the observer's state is no number", core_kinds.observer_state(kinds.NAN)
    ),
    _whole(
        "observer_nan_stays",
        "the observer's state is no number, again and again",
        core_kinds.observer_lost(),
    ),
    _whole(
        "nan_setpoint", "a controller's setpoints are no numbers", kinds.levels(kinds.nan_setpoint)
    ),
    Fault(
        "nan_guidance", "where the plan wants the axis is no number", core_kinds.nan_in_guidance()
    ),
    Fault(
        "nan_position",
        "the position scaled from the drive's is no number",
        core_kinds.nan_in_scaling("offset_si"),
    ),
    Fault(
        "nan_effort",
        "the effort scaled from the drive's is no number",
        core_kinds.nan_in_scaling("effort_per_torque_count_si"),
    ),
)

_TIME: Final = (
    _whole("utc_forth", "the wall clock is set an hour forth", kinds.clock_set(HOUR_NS)),
    _whole("utc_back", "the wall clock is set an hour back", kinds.clock_set(-HOUR_NS)),
    _whole(
        "suspended",
        "the machine sleeps for 1 s, its monotonic clock with it",
        kinds.suspended(1000),
        lasts_s=1.0,
    ),
    _whole("overrun_1", "the core is held up for 1 cycle", kinds.held(10), lasts_s=0.01),
    _whole("overrun_3", "the core is held up for 3 cycles", kinds.held(30), lasts_s=0.03),
    _whole("overrun_6", "the core is held up for 6 cycles", kinds.held(60), lasts_s=0.06),
)

_GATEWAY: Final = (
    _whole(
        "zenoh_lost",
        "the session of clients is lost: the gateway lives and has nothing to say",
        kinds.levels(kinds.no_requests),
    ),
    _whole(
        "gateway_dead",
        "the gateway is dead (SIGTERM, SIGKILL), and comes back",
        kinds.gateway_silent(),
    ),
    _whole(
        "gateway_35ms",
        "the gateway stands still for 35 ms (SIGSTOP)",
        kinds.gateway_silent(),
        lasts_s=0.035,
    ),
    _whole("gateway_200ms", "the gateway stalls for 0.2 s", kinds.gateway_silent(), lasts_s=0.2),
    _whole(
        "gateway_2s",
        "the gateway stands still for 2 s (SIGSTOP)",
        kinds.gateway_silent(),
        lasts_s=2.0,
    ),
    _whole("gateway_floods", "the gateway sends 10 000 levels a second", kinds.levels(kinds.flood)),
    _whole(
        "gateway_restarted",
        "the gateway begins anew, all its counts from zero",
        kinds.levels(kinds.restarted),
    ),
    _whole(
        "foreign_gateway_state",
        "levels for another core, with a request to enable",
        kinds.levels(kinds.foreign),
    ),
    _whole(
        "only_foreign", "nothing but levels for another core", kinds.levels(kinds.foreign_alone)
    ),
    _whole(
        "stop_count_down",
        "the count of stops goes down",
        kinds.levels(kinds.lower_stop_count),
        lasts_s=0.5,
    ),
)

_PROCESS: Final = (
    _whole("core_35ms", "the core stands still for 35 ms (SIGSTOP)", kinds.held(35), lasts_s=0.035),
    _whole("core_2s", "the core stands still for 2 s (SIGSTOP)", kinds.held(2000), lasts_s=2.0),
    _whole("core_sigterm", "the core is asked to end", kinds.terminated()),
    _whole(
        "core_sigkill", "the core is dead; a new one starts 1 s later", kinds.killed(), lasts_s=1.0
    ),
    _whole(
        "out_of_memory",
        "an allocation in a cycle fails; a new core starts later",
        core_kinds.out_of_memory(),
        lasts_s=1.0,
    ),
    _whole(
        "notebook_full",
        "the notebook cannot be written (disk full)",
        core_kinds.notebook_full(),
        lasts_s=1.0,
    ),
    _whole(
        "ring_full", "the ring cannot be written (disk full)", core_kinds.ring_full(), lasts_s=1.0
    ),
)

_NONE: Final = _whole(
    "none", "nothing: the column by itself", FaultAction(kinds.nothing, kinds.nothing)
)

_ROWS: Final = {
    "drive": _DRIVE,
    "emergency": tuple(emergencies()),
    "bus": _BUS,
    "sensor": (*_SENSORS, *_LEFTOVERS),
    "mechanics": _MECHANICS,
    "number": _NUMBERS,
    "time": _TIME,
    "gateway": _GATEWAY,
    "process": _PROCESS,
}
FAMILIES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {family: tuple(fault.name for fault in faults) for family, faults in _ROWS.items()}
)
"""Names of the faults by family."""
FAULTS: Final[Mapping[str, Fault]] = MappingProxyType(
    {fault.name: fault for fault in (_NONE, *(one for row in _ROWS.values() for one in row))}
)
"""Faults by name, in the order of the pages."""
