"""Each cause of a stop: what it says to a person, whose matter it is, and what to do about it.

The stop category of a cause is not here: `limits.toml` gives it, except where the design fixes it
(`FIXED_CATEGORY`). Doubtful feedback of an axis is S0 for that axis and S1 for the other, because
an axis must never be asked to hold by an encoder that cannot be trusted; the table holds the
category for the axis of the cause, `OTHER_AXES_CATEGORY` that of the rest.
"""

from enum import Enum
from typing import Final, NamedTuple

from daemon.record import Cause, StopCategory


class Blame(Enum):
    """Whose matter a cause is."""

    PERSON = "person"
    OPERATOR = "operator"
    DRIVE = "drive"
    MACHINE = "machine"
    SERVICE = "service"


class CauseText(NamedTuple):
    """What a person reads."""

    title: str
    blame: Blame
    remedy: str


CAUSE_TEXT: Final[dict[Cause, CauseText]] = {
    Cause.NONE: CauseText("no stop", Blame.SERVICE, "nothing to do"),
    Cause.STOP_REQUESTED: CauseText(
        "somebody asked to stop", Blame.PERSON, "reset, then enable again when everybody is ready"
    ),
    Cause.SHUTDOWN: CauseText(
        "the service was asked to end", Blame.OPERATOR, "start the service again"
    ),
    Cause.GATEWAY_SILENT: CauseText(
        "the gateway fell silent", Blame.SERVICE, "see the gateway's log; reset when it is back"
    ),
    Cause.CYCLE_OVERRUN: CauseText(
        "the 10 ms cycle did not finish in time",
        Blame.SERVICE,
        "run `gaitd doctor`; something else used the processor",
    ),
    Cause.COMMAND_NOT_FINITE: CauseText(
        "a command was not a finite number", Blame.SERVICE, "report it with the black box"
    ),
    Cause.LAST_END_UNKNOWN: CauseText(
        "nobody knows how the last run of the service ended",
        Blame.SERVICE,
        "look at the patient and the machine, then reset",
    ),
    Cause.HAND_SWITCH_OPEN: CauseText(
        "the hand switch is open", Blame.PERSON, "hold the hand switch, reset, enable"
    ),
    Cause.STO_ACTIVE: CauseText(
        "safe torque off is active",
        Blame.PERSON,
        "release the emergency stop, reset, enable",
    ),
    Cause.BUS_DOWN: CauseText(
        "the CAN bus is not there", Blame.MACHINE, "check the adapter and that the link is up"
    ),
    Cause.DRIVE_SILENT: CauseText(
        "a drive does not answer", Blame.DRIVE, "check its supply and its CAN cable, then reset"
    ),
    Cause.HEARTBEAT_LOST: CauseText(
        "a drive's heartbeat stopped", Blame.DRIVE, "check its supply and its CAN cable, then reset"
    ),
    Cause.DRIVE_REBOOTED: CauseText(
        "a drive restarted in operation", Blame.DRIVE, "check its supply; reset brings it up again"
    ),
    Cause.DRIVE_NOT_OPERATIONAL: CauseText(
        "a drive left the NMT state operational", Blame.DRIVE, "reset brings it up again"
    ),
    Cause.DRIVE_FAULT: CauseText(
        "a drive is in fault", Blame.DRIVE, "remove what its EMCY code names, then reset"
    ),
    Cause.EMERGENCY: CauseText(
        "a drive sent an emergency message",
        Blame.DRIVE,
        "remove what its EMCY code names, then reset",
    ),
    Cause.DRIVE_LEFT_ENABLED: CauseText(
        "a drive left operation enabled by itself", Blame.DRIVE, "look at its EMCY history; reset"
    ),
    Cause.MODE_NOT_SHOWN: CauseText(
        "a drive did not show the mode it was asked for", Blame.DRIVE, "reset; check its firmware"
    ),
    Cause.NOT_FOLLOWING: CauseText(
        "a drive does not follow its target", Blame.DRIVE, "check its limits and inputs; reset"
    ),
    Cause.BRING_UP_FAILED: CauseText(
        "a drive refused its configuration or is another drive",
        Blame.OPERATOR,
        "compare the drive with its file",
    ),
    Cause.DRIVE_POWERED: CauseText(
        "a drive was found holding the leg, since a stop before this start",
        Blame.DRIVE,
        "support the leg, then reset: the drives will be switched off",
    ),
    Cause.DRIVE_ENABLED_UNASKED: CauseText(
        "a drive is enabled, and not by this service",
        Blame.MACHINE,
        "press the emergency stop; find the other master on the bus, then reset",
    ),
    Cause.BUS_OFF: CauseText(
        "the CAN controller went bus-off",
        Blame.MACHINE,
        "check termination and bit rate; set the interface down and up, then reset",
    ),
    Cause.TRANSMIT_QUEUE_FULL: CauseText(
        "frames could not be sent", Blame.MACHINE, "check that another node acknowledges; reset"
    ),
    Cause.ENCODER_FROZEN: CauseText(
        "an encoder stands still while its drive pushes: frozen, or the joint is blocked",
        Blame.DRIVE,
        "free the joint, check the encoder, then reset",
    ),
    Cause.ENCODER_JUMP: CauseText(
        "an encoder jumped farther than the joint can move", Blame.DRIVE, "check the encoder"
    ),
    Cause.UNREFERENCED: CauseText(
        "an axis does not know its position", Blame.OPERATOR, "reference the axis"
    ),
    Cause.SIGN_WRONG: CauseText(
        "a joint moves against its drive's torque",
        Blame.MACHINE,
        "check motor and encoder wiring, then commission the axis",
    ),
    Cause.EFFORT_DEVIATION: CauseText(
        "a drive does not give the torque it was asked for, or measures it wrongly",
        Blame.DRIVE,
        "reset; if it comes back, have the drive's current measurement checked",
    ),
    Cause.POSITION_LIMIT: CauseText(
        "a joint left its range", Blame.PERSON, "release the leg, move it back by hand, reset"
    ),
    Cause.VELOCITY_LIMIT: CauseText("a joint was too fast", Blame.PERSON, "reset; slow down"),
    Cause.EFFORT_LIMIT: CauseText(
        "a drive's torque or force was above its limit", Blame.PERSON, "reset; look for resistance"
    ),
    Cause.POWER_LIMIT: CauseText(
        "a drive put more power into the leg than allowed", Blame.PERSON, "reset; slow down"
    ),
    Cause.TRACKING_LIMIT: CauseText(
        "a joint was too far from where it was guided", Blame.PERSON, "reset; look for resistance"
    ),
    Cause.TEMPERATURE_LIMIT: CauseText("a drive is too hot", Blame.DRIVE, "let it cool, reset"),
    Cause.SINGULARITY: CauseText(
        "the leg came too close to its stretched pose",
        Blame.PERSON,
        "bend the knee by hand, reset",
    ),
    Cause.LIMIT_SWITCH: CauseText(
        "a joint ran on to its limit switch",
        Blame.MACHINE,
        "reset, enable, move away from it; check the reference of the axis",
    ),
    Cause.ENERGY_LIMIT: CauseText(
        "the drives put more energy into the leg in one stride than allowed",
        Blame.PERSON,
        "reset; look for resistance; walk with less assist",
    ),
    Cause.STOPPING_PATH: CauseText(
        "the leg was so fast that it could not have stopped inside its range",
        Blame.PERSON,
        "reset; slow down",
    ),
    Cause.OBSERVER_INVALID: CauseText(
        "the estimate cannot be trusted", Blame.SERVICE, "reset; look at robot.toml and the events"
    ),
    Cause.STATIC_LOAD_WRONG: CauseText(
        "the load at rest is not that of the configured leg",
        Blame.OPERATOR,
        "check patient data, straps and springs",
    ),
    Cause.SPASM: CauseText(
        "the patient suddenly worked hard against the motion",
        Blame.PERSON,
        "wait until the leg is relaxed; reset, then enable",
    ),
    Cause.SELF_TEST_FAILED: CauseText(
        "the self-test found something that is not as configured",
        Blame.MACHINE,
        "do what its line in the events says, then test again",
    ),
    Cause.STOP_NOT_OBEYED: CauseText(
        "a drive did not obey a stop", Blame.DRIVE, "press the emergency stop; service the drive"
    ),
}

FIXED_CATEGORY: Final[dict[Cause, StopCategory]] = {
    Cause.ENCODER_FROZEN: StopCategory.S0,
    Cause.ENCODER_JUMP: StopCategory.S0,
    Cause.UNREFERENCED: StopCategory.S0,
    Cause.SIGN_WRONG: StopCategory.S0,
    Cause.DRIVE_SILENT: StopCategory.S1,
    Cause.HEARTBEAT_LOST: StopCategory.S1,
    Cause.DRIVE_REBOOTED: StopCategory.S1,
    Cause.DRIVE_NOT_OPERATIONAL: StopCategory.S1,
    Cause.HAND_SWITCH_OPEN: StopCategory.S1,
    Cause.SHUTDOWN: StopCategory.S1,
    Cause.STO_ACTIVE: StopCategory.S0,
    Cause.BUS_DOWN: StopCategory.S1,
    Cause.BUS_OFF: StopCategory.S1,
    Cause.DRIVE_ENABLED_UNASKED: StopCategory.S0,
    Cause.COMMAND_NOT_FINITE: StopCategory.S1,
    Cause.LAST_END_UNKNOWN: StopCategory.S1,
    Cause.STOP_NOT_OBEYED: StopCategory.S0,
}
"""Fixed by the design: a file cannot choose them."""

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
"""`limits.toml` must give each of these a category; the rest is fixed or never stops a motion."""
