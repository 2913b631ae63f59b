"""Faults of a virtual drive that stop a gait, and the sample of the fault matrix in `make test`."""

from daemon.ipc.record import Cause
from gaitd_lab.fault_matrix.cell import Cell
from gaitd_lab.fault_matrix.faults import FAULTS
from gaitd_lab.fault_matrix.modes import COLUMNS, Group
from gaitd_lab.fault_matrix.run import cells
from gaitd_lab.fault_matrix.watch import AXES

LOST = {Cause.DRIVE_SILENT, Cause.HEARTBEAT_LOST, Cause.DRIVE_REBOOTED}
STUCK = {Cause.ENCODER_FROZEN, Cause.TRACKING_LIMIT, Cause.OBSERVER_INVALID}
STOPPING = [
    ("tpdo_lost", "lost_tpdo {}", LOST),
    ("tpdo_late_6ms", "late_tpdo {} - 6", LOST),
    ("silent", "silent {}", LOST),
    ("unplugged", "unplugged {}", LOST),
    ("drive_bus_off", "bus_off {}", LOST),
    ("drive_error_passive", "bus_passive {}", {Cause.EMERGENCY, Cause.DRIVE_FAULT}),
    ("rebooted", "reboot {}", LOST),
    ("emcy_2xxx_fault", "emcy {} - 0x2310", {Cause.EMERGENCY, Cause.DRIVE_FAULT}),
    ("encoder_frozen", "frozen_encoder {}", STUCK),
    ("encoder_jump", "encoder_glitch {} - 2000", {Cause.ENCODER_JUMP}),
    ("blocked_rotor", "blocked_rotor {}", STUCK),
    ("hand_switch", "hand_switch_open {}", {Cause.HAND_SWITCH_OPEN}),
    ("limit_switch", "limit_switch_on {} - 1", {Cause.LIMIT_SWITCH}),
    ("sto", "sto_open {}", {Cause.STO_ACTIVE}),
    ("deaf", "deaf {}", LOST),
    ("silent", "wrong_identity {}", LOST),
    ("brake_stuck", "brake_stuck {}", STUCK),
    ("wrong_sign", "wrong_sign {}", {Cause.SIGN_WRONG}),
    ("encoder_reversed", "encoder_reversed {}", {Cause.SIGN_WRONG}),
    ("torque_offset", "torque_offset {} - 3000", {Cause.EFFORT_DEVIATION}),
]
"""Row of the fault matrix, command of the virtual drive with a place for the axis, and causes."""


def sample() -> list[Cell]:
    """Each fault once, modes and axes in turn; where its mode has no power, in the gait as well."""
    found: list[Cell] = []
    for number, fault in enumerate(sorted(FAULTS)):
        turn, place = divmod(number, len(COLUMNS))
        own = list(COLUMNS.values())[place]
        for mode in [own.name, *["gait_impedance"] * (own.group is Group.IDLE)]:
            on_each_axis = cells((fault,), (mode,))
            found.append(on_each_axis[turn % len(on_each_axis)])
    return found


def other_axis(row: str) -> str:
    """The axis on which the sample does not play this row."""
    played = next(cell.axis for cell in sample() if cell.fault == row)
    return next(axis for axis in AXES if axis != played)
