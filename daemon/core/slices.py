"""The values that the steps of a cycle return: each is made anew in every cycle by one module.

They are frozen: who reads one cannot change it. `tests/daemon/core/test_state_writers.py` names the
module that makes each of them.
"""

import math
from collections.abc import Mapping
from typing import Final

from gaitd_names import Doubt, Finding, Lapse, Role, SetpointRefusal
from msgspec import Struct

from daemon.core.motion.gait_shape import Pair
from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.inverse_dynamics import InverseDynamics
from daemon.core.safety.joints import Joint
from daemon.core.safety.soft_limits import SoftZone
from daemon.ipc.record import Request, Setpoint
from drives.signals import DriveFeedback, OperationMode
from observer.baseline import Baseline, PassiveStrides, Since
from observer.drift import NO_DRIFT, Drift
from observer.filter.considered import NOTHING_KNOWN, Known
from observer.filter.leg_observer import LegEstimate
from observer.strides import Stride


class Sensed(Struct, frozen=True):
    """What the samples of one axis show, and how far its position is known: `steps/sensing.py`."""

    feedback: DriveFeedback | None = None
    """None until the first sample, and without drives."""
    joint: Joint = Joint()
    origin_moved: bool = False
    """This sample is the first after a change of the position's origin by a homing."""
    referenced: bool = False
    followed: bool = False
    """Referenced, and since then no reboot or silence of its drive, no doubtful feedback, and no
    homing that has not ended."""
    doubt: Doubt = Doubt.NOT_HOMED
    watched: bool = False
    """Its drive has been neither silent nor rebooted since a bring-up: it is still the same one."""
    sign_trusted: bool = False
    """Its sign is proven for a drive with a serial number; its last reboot, silence or doubtful
    feedback came before the newest test of the sign."""
    shown_unpowered: bool = False
    """The drive has shown a state without power since power was last requested."""
    reached_enabled: bool = False
    """The drive has been enabled, in its mode and following, since this was requested."""
    unready_cycles: int = 0
    """Cycles in a row in which it should be enabled, in its mode and following, and was not."""
    unexpected_enable_cycles: int = 0
    """Cycles in a row in which it had power, or may have had, without a request by the core."""
    emergencies_checked: int = 0
    """Count of EMCY alarms already checked: each alarm is checked once."""
    bring_up_error: tuple[int, str] = (0, "")
    """Code and text of the fault that bring-up found in the drive; 0 and empty once it is gone."""
    gravity_si: float = 0.0
    """Effort that holds the joint at its newest known pose: N·m or N."""
    tracking_si: float = 0.0
    """Distance to a guided reference; else 0."""
    wanted_velocity_si: float = 0.0
    """Velocity of a guided reference; else 0."""


class Placed(Struct, frozen=True):
    """Where the samples of both axes put a leg: `steps/sensing.py`."""

    singularity_ratio: float = 1.0
    held_cycles: int = 0
    """Cycles in a row in which mode HOLD has held a pose that does not change."""


class Inputs(Struct, frozen=True):
    """What was received from the gateway: `inputs.py`."""

    stop: bool = False
    """A stop came in this cycle."""
    request: Request | None = None
    """New in this cycle and not checked yet."""
    stop_count: int | None = None
    gateway_state_seq: int = 0
    """`seq` of the newest gateway state used."""
    gateway_state_cycle: int = 0
    """`for_cycle` of the newest gateway state: the gateway's age is counted from here."""
    setpoints: tuple[Setpoint, ...] = ()
    """The newest setpoint of each leg in the newest gateway state."""
    lease: int = 0
    """The lease that is held according to the newest gateway state; 0: none."""
    lease_dropped: int = 0
    """Lease in the newest gateway state whose holder has no right to it; 0: none."""
    lease_role: Role = Role.DISPLAY
    """Role of the holder of the lease in the newest gateway state."""


class Monitored(Struct, frozen=True):
    """What is monitored of a leg from raw values: `steps/monitors.py`. Hip first, then slide."""

    dynamics: InverseDynamics = InverseDynamics()
    watches: tuple[EffortWatch, EffortWatch] = (EffortWatch(), EffortWatch())
    """The efforts of each axis."""
    window_cycles: int = 1
    """Length of the energy window: a stride, or the configured window where there is no stride."""
    stopping_end_si: Pair = (0.0, 0.0)
    """Positions at which the axes come to rest if they brake now: rad, m."""
    stopping_ratio: float = 1.0
    """Least singularity ratio on the way to rest."""
    zone: SoftZone = SoftZone()


class Advice(Struct, frozen=True):
    """Why an axis should be calibrated."""

    friction: bool = False
    offset: bool = False
    """Told of an empty machine alone, as `slope`."""
    slope: bool = False


NO_ADVICE: Final = Advice()


class Estimated(Struct, frozen=True):
    """What the observer of a leg says in this cycle: `steps/estimation.py`. Hip first, then slide.

    The smoothed state, and with it the stride, is that of 150 ms ago: it is for display; a
    controller gets the estimate of the present cycle.
    """

    estimate: LegEstimate | None = None
    """None without drives, and until the observer has begun at a known pose."""
    measured: Pair = (math.nan, math.nan)
    """Positions of this cycle's samples: rad and m; NaN where a sample is missing."""
    effort_used: Pair = (0.0, 0.0)
    """Measured efforts without the artificial part: N·m and N."""
    artificial: Pair = (0.0, 0.0)
    """Artificial disturbance of the observer's input: N·m and N."""
    bad_cycles: int = 0
    """Cycles in a row without a valid estimate while the observer runs."""
    stride: Stride | None = None
    """The stride that was completed in this cycle; None if there was none."""
    stride_count: int = 0
    drifts: tuple[Drift, Drift] = (NO_DRIFT, NO_DRIFT)
    """Drift of the friction of each axis."""
    advice: tuple[Advice, Advice] = (NO_ADVICE, NO_ADVICE)


class Passive(Struct, frozen=True):
    """What is known of a leg by a minute with a passive patient: `steps/passive.py`."""

    known: Known = NOTHING_KNOWN
    """What the observer takes off its estimate."""
    baseline: Baseline | None = None
    taken_cycle: int | None = None
    """Cycle in which it was taken; None: an unknown time ago."""
    guidance_ratio: float = 1.0
    """Share of the guidance stiffness at the end of the minute."""
    temperatures_degc: tuple[float | None, float | None] = (None, None)
    """Temperatures of the drives of hip and slide at the end of the minute."""
    since: Since = Since()
    """What is other than in the minute, for `known`."""
    strides: PassiveStrides | None = None
    """Strides of the minute under way; an object that `steps/passive.py` alone adds to."""
    growing_strides: int = 0
    """Strides until the gait has grown, which are not of the minute."""
    finding: Finding = Finding.NONE
    """Why the newest minute gave no baseline."""
    found: tuple[int, float, float] = (0, 0.0, 0.0)
    """Axis, value and limit of `finding`."""


class Assisted(Struct, frozen=True):
    """What controllers may do, and how their setpoints have fared: `steps/controllers.py`."""

    torque_lease: int = 0
    """The lease with which mode TORQUE was entered."""
    cap_si: Pair = (math.inf, math.inf)
    """Cap of assist by the released plan of a session's gait: hip and slide, N·m and N."""
    accepted_count: int = 0
    refused_count: Mapping[SetpointRefusal, int] = {}
    """Refused setpoints by reason."""
    lapse_count: int = 0
    lapse_reason: Lapse = Lapse.NONE
    """Reason of the newest lapse of assist."""


class LegAssist(Struct, frozen=True):
    """A controller's newest setpoint for a leg, and the assist in force: `steps/controllers.py`."""

    lease: int = 0
    """The lease that `seq` and `accepted` belong to."""
    seq: int = -1
    """`seq` of the newest accepted setpoint."""
    checked: tuple[int, int, int] | None = None
    """Lease, seq and for_cycle of the newest checked setpoint.

    Every gateway state repeats the setpoint; it is checked once.
    """
    accepted: Setpoint | None = None
    """The newest accepted setpoint, followed as long as it is fresh."""
    effort_si: Pair = (0.0, 0.0)
    """Assist in force."""
    fade_si: Pair | None = None
    """Decrease of assist per cycle while it fades; None while it does not fade."""
    stiffness_ratio: float = 1.0
    """Stiffness share in force."""
    is_finite: bool = True
    """False in the cycle in which a number of the assist was not finite."""

    @property
    def added_si(self) -> Pair:
        """Assist in the command of this cycle; NaN makes the command check stop the machine."""
        return self.effort_si if self.is_finite else (math.nan, math.nan)


class Softened(Struct, frozen=True):
    """How much a spasm and clonus soften the guidance of a leg: `steps/monitors.py`."""

    spasm_ratio: float = 1.0
    """Share of the guidance stiffness that remains during a spasm."""
    clonus_ratio: float = 1.0
    """Share of the guidance stiffness that remains during clonus."""
    wanted_velocity: Pair = (0.0, 0.0)
    """Velocity of the reference, from which next its acceleration follows: rad/s, m/s."""
    needed_si: Pair | None = None
    """Effort that the reference's motion needs beyond the load: N·m, N. None: nothing is guided."""


class Sent(Struct, frozen=True):
    """What was sent to one drive, and how its targets fade to the plan: `steps/targets.py`."""

    mode: OperationMode = OperationMode.CYCLIC_SYNC_TORQUE
    """6060h of the last command, which 6061h is expected to show."""
    effort_si: float = 0.0
    position_si: float = 0.0
    """Target position of the last command, in every mode."""
    speed_si: float = 0.0
    acceleration_si: float = 0.0
    """Acceleration of the target position, from the last two commands.

    0 where the drive does not follow its target position.
    """
    effort_mean_si: float = 0.0
    """Low-pass mean of the effort sent in torque mode: it holds a joint without a control loop."""
    effort_offset_si: float = 0.0
    position_offset_si: float = 0.0
    """Difference between target and plan when guidance took over; it fades to zero."""
