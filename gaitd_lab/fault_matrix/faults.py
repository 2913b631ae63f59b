"""The rows of the matrix: each fault, what it does, how it begins and how long it lasts.

The expected results are in `expected.py`.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gaitd_lab.fault_matrix import core_kinds, kinds
from gaitd_lab.fault_matrix.emergencies import emergencies
from gaitd_lab.fault_matrix.kinds import MS, Fault, FaultAction

HOUR_NS: Final = 3_600_000 * MS


_DRIVE: Final = (
    Fault("silent", "nothing of the drive reaches the bus", kinds.machine("silent {}")),
    Fault(
        "unplugged", "the drive is cut off from the bus, both ways", kinds.machine("unplugged {}")
    ),
    Fault("deaf", "the drive hears nothing, and still sends", kinds.machine("deaf {}")),
    Fault(
        "tpdo_lost_once",
        "the TPDOs of one SYNC are lost",
        kinds.machine("lost_tpdo {} 0.010"),
        lasts_s=0.01,
    ),
    Fault(
        "tpdo_lost",
        "one of the two cyclic TPDOs does not come any more",
        kinds.machine("lost_tpdo {} - 2"),
    ),
    Fault(
        "tpdo_late_2ms",
        "TPDOs come 2 ms later, inside the window",
        kinds.machine("late_tpdo {} - 2"),
    ),
    Fault(
        "tpdo_late_6ms",
        "TPDOs come 6 ms later, after the window",
        kinds.machine("late_tpdo {} - 6"),
    ),
    Fault(
        "rebooted",
        "the drive loses its power for a moment and boots",
        kinds.machine("reboot {}"),
        lasts_s=0.01,
    ),
    Fault("drive_bus_off", "the drive's CAN controller goes bus-off", kinds.machine("bus_off {}")),
    Fault(
        "drive_error_passive",
        "the drive's CAN controller is error-passive",
        kinds.machine("bus_passive {}"),
    ),
)

_BUS: Final = (
    Fault("our_bus_off", "our CAN controller goes bus-off", kinds.our_bus_off(), of_an_axis=False),
    Fault(
        "our_error_passive",
        "our CAN controller is error-passive",
        kinds.reported(kinds.PASSIVE, kinds.ACTIVE),
        of_an_axis=False,
    ),
    Fault(
        "our_overflow",
        "our CAN controller has lost a frame",
        kinds.reported(kinds.OVERFLOW),
        of_an_axis=False,
    ),
    Fault(
        "queue_full",
        "nothing can be placed in the transmit queue",
        kinds.queue_full(),
        of_an_axis=False,
    ),
    Fault(
        "queue_full_once",
        "the transmit queue is full for one cycle",
        kinds.queue_full(),
        of_an_axis=False,
        lasts_s=0.01,
    ),
    Fault(
        "adapter_gone", "the CAN interface is pulled out", kinds.adapter_gone(), of_an_axis=False
    ),
    Fault(
        "sync_late_2ms", "each SYNC waits 2 ms for the wire", kinds.sync_waits(2), of_an_axis=False
    ),
    Fault(
        "sync_late_6ms", "each SYNC waits 6 ms for the wire", kinds.sync_waits(6), of_an_axis=False
    ),
)

_SENSORS: Final = (
    Fault(
        "encoder_frozen",
        "the reported position does not change",
        kinds.machine("frozen_encoder {}"),
    ),
    Fault(
        "encoder_jump",
        "the position that is reported is 4000 counts off",
        kinds.machine("encoder_glitch {} - 4000"),
    ),
    Fault(
        "encoder_jump_once",
        "one sample is 4000 counts off",
        kinds.machine("encoder_glitch {} 0.010 4000"),
        lasts_s=0.01,
    ),
    Fault(
        "encoder_reversed", "the encoder counts the wrong way", kinds.machine("encoder_reversed {}")
    ),
    Fault("wrong_sign", "the motor turns the wrong way", kinds.machine("wrong_sign {}")),
    Fault(
        "torque_offset",
        "the current sensor shows 3 A too much",
        kinds.machine("torque_offset {} - 3000"),
    ),
)

_MECHANICS: Final = (
    Fault("blocked_rotor", "the joint is jammed", kinds.machine("blocked_rotor {}")),
    Fault("brake_stuck", "the brake has closed and does not open", kinds.machine("brake_stuck {}")),
    Fault("end_stop", "the patient pushes the joint into its stop", kinds.patient("into_{}_stop")),
    Fault(
        "voluntary_push",
        "the patient pushes at a leg that stands, 10 N m and 60 N within 0.3 s",
        kinds.patient("pushes"),
        of_an_axis=False,
        lasts_s=6.2,
    ),
    Fault(
        "spasm",
        "the patient contracts hard against the motion",
        kinds.patient("spasm"),
        of_an_axis=False,
        lasts_s=2.2,
    ),
    Fault("limit_switch", "the limit switch ahead of the joint closes", kinds.limit_switch_ahead()),
    Fault(
        "hand_switch", "the patient releases the hand switch", kinds.machine("hand_switch_open {}")
    ),
    Fault("sto", "safe torque off", kinds.machine("sto_open {}")),
    Fault(
        "deaf_to_quick_stop",
        "the drive shows quick stop, goes on as before, and the hand switch is let go",
        kinds.together(
            kinds.machine("ignores_quick_stop {}"), kinds.machine("hand_switch_open {}")
        ),
    ),
)

_NUMBERS: Final = (
    Fault(
        "observer_diverged",
        "the observer's state is far from anything",
        core_kinds.observer_state(1e4),
        of_an_axis=False,
    ),
    Fault(
        "observer_nan",
        "the observer's state is no number",
        core_kinds.observer_state(kinds.NAN),
        of_an_axis=False,
    ),
    Fault(
        "observer_nan_stays",
        "the observer's state is no number, again and again",
        core_kinds.observer_lost(),
        of_an_axis=False,
    ),
    Fault(
        "nan_setpoint",
        "a controller's setpoints are no numbers",
        kinds.levels(kinds.nan_setpoint),
        of_an_axis=False,
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
    Fault(
        "utc_forth",
        "the wall clock is set an hour forth",
        kinds.clock_set(HOUR_NS),
        of_an_axis=False,
    ),
    Fault(
        "utc_back",
        "the wall clock is set an hour back",
        kinds.clock_set(-HOUR_NS),
        of_an_axis=False,
    ),
    Fault(
        "suspended",
        "the machine sleeps for 1 s, its monotonic clock with it",
        kinds.suspended(1000),
        of_an_axis=False,
        lasts_s=1.0,
    ),
    Fault(
        "overrun_1",
        "the core is held up for 1 cycle",
        kinds.held(10),
        of_an_axis=False,
        lasts_s=0.01,
    ),
    Fault(
        "overrun_3",
        "the core is held up for 3 cycles",
        kinds.held(30),
        of_an_axis=False,
        lasts_s=0.03,
    ),
    Fault(
        "overrun_6",
        "the core is held up for 6 cycles",
        kinds.held(60),
        of_an_axis=False,
        lasts_s=0.06,
    ),
)

_GATEWAY: Final = (
    Fault(
        "zenoh_lost",
        "the session of clients is lost: the gateway lives and has nothing to say",
        kinds.levels(kinds.no_requests),
        of_an_axis=False,
    ),
    Fault(
        "gateway_dead",
        "the gateway is dead (SIGTERM, SIGKILL), and comes back",
        kinds.gateway_silent(),
        of_an_axis=False,
    ),
    Fault(
        "gateway_35ms",
        "the gateway stands still for 35 ms (SIGSTOP)",
        kinds.gateway_silent(),
        of_an_axis=False,
        lasts_s=0.035,
    ),
    Fault(
        "gateway_200ms",
        "the gateway stalls for 0.2 s",
        kinds.gateway_silent(),
        of_an_axis=False,
        lasts_s=0.2,
    ),
    Fault(
        "gateway_2s",
        "the gateway stands still for 2 s (SIGSTOP)",
        kinds.gateway_silent(),
        of_an_axis=False,
        lasts_s=2.0,
    ),
    Fault(
        "gateway_floods",
        "the gateway sends 10 000 levels a second",
        kinds.levels(kinds.flood),
        of_an_axis=False,
    ),
    Fault(
        "gateway_restarted",
        "the gateway begins anew, all its counts from zero",
        kinds.levels(kinds.restarted),
        of_an_axis=False,
    ),
    Fault(
        "foreign_gateway_state",
        "levels for another core, with a request to enable",
        kinds.levels(kinds.foreign),
        of_an_axis=False,
    ),
    Fault(
        "only_foreign",
        "nothing but levels for another core",
        kinds.levels(kinds.foreign_alone),
        of_an_axis=False,
    ),
    Fault(
        "stop_count_down",
        "the count of stops goes down",
        kinds.levels(kinds.lower_stop_count),
        of_an_axis=False,
        lasts_s=0.5,
    ),
)

_PROCESS: Final = (
    Fault(
        "core_35ms",
        "the core stands still for 35 ms (SIGSTOP)",
        kinds.held(35),
        of_an_axis=False,
        lasts_s=0.035,
    ),
    Fault(
        "core_2s",
        "the core stands still for 2 s (SIGSTOP)",
        kinds.held(2000),
        of_an_axis=False,
        lasts_s=2.0,
    ),
    Fault("core_sigterm", "the core is asked to end", kinds.terminated(), of_an_axis=False),
    Fault(
        "core_sigkill",
        "the core is dead; a new one starts 1 s later",
        kinds.killed(),
        of_an_axis=False,
        lasts_s=1.0,
    ),
    Fault(
        "out_of_memory",
        "an allocation in a cycle fails; a new core starts later",
        core_kinds.out_of_memory(),
        of_an_axis=False,
        lasts_s=1.0,
    ),
    Fault(
        "notebook_full",
        "the notebook cannot be written (disk full)",
        core_kinds.notebook_full(),
        of_an_axis=False,
        lasts_s=1.0,
    ),
    Fault(
        "ring_full",
        "the ring cannot be written (disk full)",
        core_kinds.ring_full(),
        of_an_axis=False,
        lasts_s=1.0,
    ),
)

_NONE: Final = Fault(
    "none",
    "nothing: the column by itself",
    FaultAction(kinds.nothing, kinds.nothing),
    of_an_axis=False,
)

_ROWS: Final = {
    "drive": _DRIVE,
    "emergency": tuple(emergencies()),
    "bus": _BUS,
    "sensor": _SENSORS,
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
