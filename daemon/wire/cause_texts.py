"""Texts for each cause of a stop: title, responsible party, and instructions for a layperson.

The instructions have three parts: first (with a person strapped in, before anything else), then
(how to continue), and what to do if it comes back. Plain words, commands as they are typed.
"""

from enum import Enum
from typing import Final, NamedTuple

from daemon.ipc.record import Cause


class Blame(Enum):
    """The party responsible for a cause."""

    PERSON = "person"
    OPERATOR = "operator"
    DRIVE = "drive"
    MACHINE = "machine"
    SERVICE = "service"


class CauseText(NamedTuple):
    """Text for a reader who is no engineer, with a person strapped in."""

    title: str
    blame: Blame
    first: str
    """At once, before anything else."""
    then: str
    """How to continue."""
    again: str
    """If it comes back."""

    @property
    def remedy(self) -> str:
        """All three parts in one line."""
        return f"first: {self.first}; then: {self.then}; if it comes back: {self.again}"


HELD: Final = (
    "lie still, the leg is held; a second person supports it before `gaitd reset` releases it"
)
LOOSE: Final = (
    "lie still, keep hands off the slide; a second person supports the leg, which may not be held"
)
DANGER: Final = (
    "press the emergency stop; a second person supports the leg, which is not held any more"
)
GET_OUT: Final = (
    "`gaitd reset`, `gaitd enable`, then `gaitd mode hand_guiding` and lead the leg out by hand"
)
GO_ON: Final = "`gaitd reset`, then `gaitd enable`; to get out, then `gaitd mode hand_guiding`"
CALL_SERVICE: Final = "keep the recording and call the software support"
CALL_TECHNICIAN: Final = "do not use the machine, call the technician"
CALL_OPERATOR: Final = "call the operator who set up the machine for this person"

CAUSE_TEXT: Final[dict[Cause, CauseText]] = {
    Cause.NONE: CauseText(
        "no stop",
        Blame.SERVICE,
        "nothing has to be done",
        "nothing",
        "nothing",
    ),
    Cause.STOP_REQUESTED: CauseText(
        "a person or a client requested a stop",
        Blame.PERSON,
        HELD,
        f"find out why; {GO_ON}",
        "find out who requests the stops (`gaitd status`), and why",
    ),
    Cause.SHUTDOWN: CauseText(
        "the service was shut down",
        Blame.OPERATOR,
        LOOSE,
        "start the service again",
        CALL_OPERATOR,
    ),
    Cause.GATEWAY_SILENT: CauseText(
        "the core receives nothing from the gateway",
        Blame.SERVICE,
        HELD,
        f"wait until `gaitd status` answers; {GO_ON}",
        CALL_SERVICE,
    ),
    Cause.CYCLE_OVERRUN: CauseText(
        "the 10 ms cycle did not finish in time",
        Blame.SERVICE,
        HELD,
        f"run `gaitd doctor`, because something else used the processor; {GO_ON}",
        CALL_SERVICE,
    ),
    Cause.COMMAND_NOT_FINITE: CauseText(
        "a command was not a finite number",
        Blame.SERVICE,
        HELD,
        f"keep the recording; {GET_OUT}, and do not continue the session",
        CALL_SERVICE,
    ),
    Cause.LAST_END_UNKNOWN: CauseText(
        "it is unknown how the last run of the service ended",
        Blame.SERVICE,
        LOOSE,
        f"check the person and the machine; {GO_ON}",
        CALL_SERVICE,
    ),
    Cause.HAND_SWITCH_OPEN: CauseText(
        "the hand switch is open",
        Blame.PERSON,
        HELD,
        f"hold the hand switch; {GO_ON}",
        "have the hand switch and its cable checked",
    ),
    Cause.STO_ACTIVE: CauseText(
        "safe torque off is active",
        Blame.PERSON,
        LOOSE,
        f"find out why the emergency stop was pressed, release it; {GO_ON}",
        "have the emergency stop and its wires checked",
    ),
    Cause.INPUTS_IMPOSSIBLE: CauseText(
        "a drive shows inputs that no wiring can produce",
        Blame.DRIVE,
        HELD,
        f"switch the drive off and on; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.BUS_DOWN: CauseText(
        "the CAN interface is missing or down",
        Blame.MACHINE,
        DANGER,
        f"check the adapter and that the link is up; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.DRIVE_SILENT: CauseText(
        "a drive does not answer",
        Blame.DRIVE,
        DANGER,
        f"check its supply and its CAN cable; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.HEARTBEAT_LOST: CauseText(
        "a drive's heartbeat stopped",
        Blame.DRIVE,
        DANGER,
        f"check its supply and its CAN cable; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.DRIVE_REBOOTED: CauseText(
        "a drive restarted in operation",
        Blame.DRIVE,
        DANGER,
        f"check its supply; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.DRIVE_NOT_OPERATIONAL: CauseText(
        "a drive left the NMT state operational",
        Blame.DRIVE,
        DANGER,
        f"look for another master on the bus; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.DRIVE_FAULT: CauseText(
        "a drive is in fault",
        Blame.DRIVE,
        HELD,
        f"remove what its EMCY code names; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.EMERGENCY: CauseText(
        "a drive sent an emergency message",
        Blame.DRIVE,
        HELD,
        f"remove what its EMCY code names; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.DRIVE_LEFT_ENABLED: CauseText(
        "a drive left operation enabled by itself",
        Blame.DRIVE,
        LOOSE,
        f"look at its EMCY history (`gaitd status`); {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.MODE_NOT_SHOWN: CauseText(
        "a drive did not change to the commanded mode of operation",
        Blame.DRIVE,
        HELD,
        GO_ON,
        CALL_TECHNICIAN,
    ),
    Cause.NOT_FOLLOWING: CauseText(
        "a drive does not follow its target",
        Blame.DRIVE,
        HELD,
        f"check its limits and inputs; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.BRING_UP_FAILED: CauseText(
        "a drive refused its configuration or is another drive",
        Blame.OPERATOR,
        "nothing moves; help the person out by hand",
        "compare the drive with its file (`gaitd scan`)",
        CALL_OPERATOR,
    ),
    Cause.DRIVE_POWERED: CauseText(
        "a drive was already enabled when the service started",
        Blame.DRIVE,
        HELD,
        "`gaitd reset`, which switches the drives off",
        CALL_SERVICE,
    ),
    Cause.UNEXPECTED_ENABLE: CauseText(
        "a drive was enabled by another master",
        Blame.MACHINE,
        DANGER,
        f"find the other master on the bus and disconnect it; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.BUS_OFF: CauseText(
        "the CAN controller went bus-off",
        Blame.MACHINE,
        DANGER,
        f"check termination and bit rate, set the interface down and up; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.TRANSMIT_QUEUE_FULL: CauseText(
        "frames could not be sent",
        Blame.MACHINE,
        DANGER,
        f"check that another node acknowledges; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.ENCODER_FROZEN: CauseText(
        "an encoder does not change under a changing effort: it is frozen, or the joint is blocked",
        Blame.DRIVE,
        LOOSE,
        f"free the joint, check the encoder; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.ENCODER_JUMP: CauseText(
        "an encoder changed by more than the joint can move in one cycle",
        Blame.DRIVE,
        LOOSE,
        "help the person out by hand; check the encoder; `gaitd reset`, `gaitd reference AXIS`",
        CALL_TECHNICIAN,
    ),
    Cause.UNREFERENCED: CauseText(
        "the position of an axis is unknown",
        Blame.OPERATOR,
        LOOSE,
        "help the person out by hand; `gaitd reset`, then `gaitd reference AXIS`, machine empty",
        CALL_OPERATOR,
    ),
    Cause.SIGN_WRONG: CauseText(
        "a joint moves against its drive's torque",
        Blame.MACHINE,
        DANGER,
        "help the person out by hand; check motor and encoder wiring; `gaitd commission AXIS`",
        CALL_TECHNICIAN,
    ),
    Cause.EFFORT_DEVIATION: CauseText(
        "a drive does not produce the commanded torque, or measures it wrongly",
        Blame.DRIVE,
        HELD,
        GO_ON,
        "have the drive's current measurement checked",
    ),
    Cause.MOVED_AGAINST_DRIVE: CauseText(
        "a joint moved against its drive, which held back less than the leg's own force",
        Blame.PERSON,
        HELD,
        f"{GO_ON}, slower: a slower gait needs less force",
        CALL_OPERATOR,
    ),
    Cause.POSITION_LIMIT: CauseText(
        "a joint left its range",
        Blame.PERSON,
        HELD,
        f"`gaitd reset`, move the leg back by hand; {GO_ON}",
        "have reference and stops of the axis checked",
    ),
    Cause.VELOCITY_LIMIT: CauseText(
        "a joint was too fast",
        Blame.PERSON,
        HELD,
        f"wait until the leg is relaxed; {GO_ON}, slower",
        CALL_OPERATOR,
    ),
    Cause.EFFORT_LIMIT: CauseText(
        "a drive's torque or force was above its limit",
        Blame.PERSON,
        HELD,
        f"find what resists the motion; {GO_ON}",
        CALL_TECHNICIAN,
    ),
    Cause.POWER_LIMIT: CauseText(
        "a drive put more power into the leg than allowed",
        Blame.PERSON,
        HELD,
        f"{GO_ON}, slower",
        CALL_OPERATOR,
    ),
    Cause.TRACKING_LIMIT: CauseText(
        "a joint was too far from its reference",
        Blame.PERSON,
        HELD,
        f"find what resists the motion, also the person; {GO_ON}",
        CALL_OPERATOR,
    ),
    Cause.TEMPERATURE_LIMIT: CauseText(
        "a drive is too hot",
        Blame.DRIVE,
        HELD,
        f"{GET_OUT}; let it cool for half an hour",
        CALL_TECHNICIAN,
    ),
    Cause.SINGULARITY: CauseText(
        "the leg came too close to its stretched pose",
        Blame.PERSON,
        HELD,
        f"`gaitd reset`, bend the knee by hand; {GO_ON}",
        CALL_OPERATOR,
    ),
    Cause.LIMIT_SWITCH: CauseText(
        "a joint moved on to its limit switch",
        Blame.MACHINE,
        HELD,
        "`gaitd reset`, `gaitd enable`, move away from it; check the reference of the axis",
        CALL_TECHNICIAN,
    ),
    Cause.ENERGY_LIMIT: CauseText(
        "the drives put more energy into the leg in one stride than allowed",
        Blame.PERSON,
        HELD,
        f"find what resists the motion; {GO_ON}, with less assist",
        CALL_OPERATOR,
    ),
    Cause.STOPPING_PATH: CauseText(
        "the leg was so fast that it could not have stopped inside its range",
        Blame.PERSON,
        HELD,
        f"{GO_ON}, slower",
        CALL_OPERATOR,
    ),
    Cause.OBSERVER_INVALID: CauseText(
        "the estimate cannot be trusted",
        Blame.SERVICE,
        HELD,
        f"check robot.toml and the events; {GO_ON}",
        CALL_SERVICE,
    ),
    Cause.STATIC_LOAD_WRONG: CauseText(
        "the load at rest is not that of the configured leg",
        Blame.OPERATOR,
        HELD,
        "`gaitd reset`; check patient data, straps and springs; `gaitd enable`",
        CALL_OPERATOR,
    ),
    Cause.SPASM: CauseText(
        "the patient's effort against the motion rose suddenly",
        Blame.PERSON,
        HELD,
        f"wait until the leg is relaxed; {GO_ON}",
        "end the session and call the physician who prescribed it",
    ),
    Cause.SELF_TEST_FAILED: CauseText(
        "the self-test found something that is not as configured",
        Blame.MACHINE,
        HELD,
        "read its line in the events; `gaitd reset`, `gaitd self-test`, with the person relaxed",
        CALL_TECHNICIAN,
    ),
    Cause.CLONUS: CauseText(
        "clonus: the leg's effort swung to and fro for long",
        Blame.PERSON,
        HELD,
        f"wait until the leg is quiet; {GO_ON}",
        "end the session and call the physician who prescribed it",
    ),
    Cause.STOP_NOT_OBEYED: CauseText(
        "a drive did not obey a stop",
        Blame.DRIVE,
        DANGER,
        "help the person out by hand; do not use the machine before it was serviced",
        CALL_TECHNICIAN,
    ),
}
