"""What goes wrong with a virtual drive while it walks, and the causes that name it."""

from daemon.ipc.record import Cause

LOST = {Cause.DRIVE_SILENT, Cause.HEARTBEAT_LOST, Cause.DRIVE_REBOOTED}
STUCK = {Cause.ENCODER_FROZEN, Cause.TRACKING_LIMIT, Cause.OBSERVER_INVALID}
FAULTS = [
    ("lost_tpdo {}", LOST),
    ("late_tpdo {} - 6", LOST),
    ("silent {}", LOST),
    ("unplugged {}", LOST),
    ("bus_off {}", LOST),
    ("bus_passive {}", {Cause.EMERGENCY, Cause.DRIVE_FAULT}),
    ("reboot {}", LOST),
    ("emcy {} - 0x2310", {Cause.EMERGENCY, Cause.DRIVE_FAULT}),
    ("frozen_encoder {}", STUCK),
    ("encoder_glitch {} - 2000", {Cause.ENCODER_JUMP}),
    ("blocked_rotor {}", STUCK),
    ("hand_switch_open {}", {Cause.HAND_SWITCH_OPEN}),
    ("limit_switch_on {} - 1", {Cause.LIMIT_SWITCH}),
    ("sto_open {}", {Cause.STO_ACTIVE}),
    ("deaf {}", LOST),
    ("wrong_identity {}", LOST),
    ("brake_stuck {}", STUCK),
]
