"""The mutable part of the core: what one cycle leaves for the next."""

from dataclasses import dataclass, field

from daemon.config.settings import Excite, Gait, HandGuiding, Impedance, SelfTest
from daemon.core.modes.persistent_state import Notes, PoseRules, Wiring
from daemon.core.motion.assist import AssistRules, LegAssist
from daemon.core.motion.hand_guiding import ReleasePlay
from daemon.core.motion.self_test import SelfTestPlay
from daemon.core.motion.single_axis import HomingRules, Preparation, PushRules, SignTest
from daemon.core.motion.trajectory import (
    ExcitePlay,
    GaitPlay,
    GaitShape,
    Hold,
    Reference,
    TorquePlay,
)
from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.energy import StrideSum
from daemon.core.safety.inverse_dynamics import Balance
from daemon.core.safety.limits import AxisLimits, Categories, Thresholds
from daemon.core.safety.soft_limits import SoftZone
from daemon.core.safety.spasm import SpasmRules, SpasmWatch
from daemon.core.safety.stop_sequence import DriveStop, StopRules
from daemon.core.steps.joints import Joint
from daemon.ipc.record import Cause, Mode, Request, RequestResult, Setpoint, Verdict
from daemon.wire.refusals import SetpointRefusal
from drives.cia402.drive import DriveGroup
from drives.cia402.torque import TorqueSampling
from drives.cia402.units import AxisScaling
from drives.signals import DriveFeedback, OperationMode
from observer.drift import NO_DRIFT, Drift
from observer.filter.leg_observer import LegEstimate, LegObserver
from observer.filter.leg_smoother import LegSmoother
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.mechanism import LegParameters
from observer.strides import Stride, StrideCounter

Play = GaitPlay | ExcitePlay | ReleasePlay | SelfTestPlay
"""What has stages, and an end."""
Plan = Hold | TorquePlay | Play


@dataclass(frozen=True, slots=True)
class CoreConfig:
    """What the core took from the configuration; never changes while it lives."""

    period_ns: int
    thresholds: Thresholds
    categories: Categories
    stop_rules: StopRules
    spasm: SpasmRules
    assist_rules: AssistRules
    hold: Impedance
    gait: Gait
    excite: dict[str, Excite]
    hand_guiding: HandGuiding
    self_test: SelfTest
    leg_digest: str
    """Of robot.toml: a self-test is about one leg and one machine."""
    patient_configured: bool
    signs_must_be_proven: bool

    @property
    def period_s(self) -> float:
        """Nominal time between two SYNCs."""
        return self.period_ns * 1e-9


@dataclass(slots=True)
class Axis:
    """One axis: what it is, and what is known of it."""

    name: str
    """`right/hip`: as in the records."""
    node_id: int
    limits: AxisLimits
    scaling: AxisScaling
    wiring: Wiring
    poses: PoseRules
    push: PushRules
    homing: HomingRules | None
    """None: this axis cannot be homed."""
    torque_sampling: TorqueSampling
    spasm: SpasmWatch
    reaction_cycles: int
    """From its drive's profile: so long a fault reaction may last."""
    serial_number: int = 0
    referenced: bool = False
    homed: bool = False
    """In this power cycle of the drive, and by us."""
    unreferenced_why: str = ""
    sign_proven: bool = False
    joint: Joint = field(default_factory=Joint)
    feedback: DriveFeedback | None = None
    stop: DriveStop | None = None
    mode_sent: OperationMode = OperationMode.CYCLIC_SYNC_TORQUE
    """6060h of the last command: what 6061h is to show."""
    seen_off: bool = False
    """Since power was last asked for its drive has shown that it is off, and not on its way."""
    effort_sent_si: float = 0.0
    position_sent_si: float = 0.0
    """Target position of the last command, whatever the mode."""
    speed_sent_si: float = 0.0
    acceleration_sent_si: float = 0.0
    """Of the target position, over the last two commands; 0 where the drive does not go by it."""
    effort_mean_si: float = 0.0
    """Of what was sent in torque mode lately: holds a joint without a loop of ours."""
    effort_offset_si: float = 0.0
    position_offset_si: float = 0.0
    """What the target had beyond the plan's wish when guidance took it over; fades away."""
    gravity_si: float = 0.0
    watch: EffortWatch = field(default_factory=EffortWatch)
    energy: StrideSum = field(default_factory=StrideSum)
    """Into the leg, J."""
    unexplained: StrideSum = field(default_factory=StrideSum)
    """Effort times cycles of a gait that plays."""
    stopping_end_si: float = 0.0
    tracking_si: float = 0.0
    wanted_velocity_si: float = 0.0
    reached_enabled: bool = False
    unready_cycles: int = 0
    unasked_cycles: int = 0
    emergencies_seen: int = 0
    """Alarms by EMCY that have been judged: each is, once."""
    error_found: str = ""
    """What the drive said of the fault in which bring-up found it; empty once that is over."""
    drift: Drift = NO_DRIFT
    calibration_advised: bool = False


@dataclass(slots=True)
class Leg:
    """One leg: two axes, an observer, and what it is meant to do."""

    name: str
    parameters: LegParameters
    shape: GaitShape
    axes: tuple[Axis, Axis]
    observer: LegObserver
    smoother: LegSmoother
    strides: StrideCounter
    friction: tuple[FrictionParameters, FrictionParameters]
    """Of hip and slide, as the observer has it."""
    phase_offset_strides: float
    plan: Plan | None = None
    reference: Reference | None = None
    estimate: LegEstimate | None = None
    measured: tuple[float, float] = (float("nan"), float("nan"))
    effort_used: tuple[float, float] = (0.0, 0.0)
    artificial: tuple[float, float] = (0.0, 0.0)
    assist: LegAssist = field(default_factory=LegAssist)
    """What a controller asked for, and what of it is in force."""
    takes_over: bool = False
    """The plan is another one since the last command, and is to begin with the effort of that."""
    assist_si: tuple[float, float] = (0.0, 0.0)
    """A controller's assist in force in this cycle, bounded: N·m, N."""
    stiffness_ratio: float = 1.0
    """Of the configured stiffness of guidance: what a controller, or a spasm, leaves of it."""
    spasm_ratio: float = 1.0
    """Of the stiffness of guidance: what a spasm leaves of it."""
    singularity_ratio: float = 1.0
    stopping_ratio: float = 1.0
    window_cycles: int = 1
    """Of a stride, or what stands in for it: energy is counted over it."""
    balance: Balance = field(default_factory=Balance)
    zone: SoftZone = field(default_factory=SoftZone)
    stride: Stride | None = None
    """Completed in this cycle."""
    stride_count: int = 0
    observer_started: bool = False
    observer_bad_cycles: int = 0


@dataclass(slots=True)
class Core:
    """Everything that one cycle leaves for the next."""

    boot_id: str
    config: CoreConfig
    legs: tuple[Leg, ...]
    drives: DriveGroup | None = None
    """None until the drives have been brought up, and after they were lost."""
    mode: Mode = Mode.OFF
    verdict: Verdict = field(default_factory=Verdict)
    """Latched until a reset; in mode OFF the reason why the drives are not there."""
    causes_told: set[tuple[Cause, str]] = field(default_factory=set[tuple[Cause, str]])
    """Since the machine was stopped: each is told once."""
    disabling: bool = False
    """STOPPING because somebody asked to disable, not because of a verdict."""
    reset_cycles_left: int = 0
    reset_settle_cycles: int = 0
    """A drive that was in fault is out of it for good once it has shown so for these."""
    """Cycles for which a requested fault reset is still being tried."""
    load_settle_cycles: int = 0
    load_checked: bool = False
    notes: Notes = field(default_factory=Notes)
    """What outlives a restart."""
    preparation: Preparation | None = None
    """One axis is being homed or its sign proven, or is about to be."""
    evidence: dict[str, SignTest] = field(default_factory=dict[str, SignTest])
    """Sign tests that went well, by axis, until somebody says what was seen."""
    request: Request | None = None
    """Accepted, and not finished yet."""
    result: RequestResult = field(default_factory=RequestResult)
    """Of the newest request that was heard: its id never falls."""
    stop_count: int | None = None
    level_seq: int = 0
    """Of the newest level that counted."""
    level_cycle: int = 0
    """`for_cycle` of the newest level: the gateway's age is counted from here."""
    setpoints: tuple[Setpoint, ...] = ()
    """The newest of each leg, as the newest level has them."""
    lease: int = 0
    """That is held, by the newest level; 0: none."""
    torque_lease: int = 0
    """With which mode TORQUE was entered."""
    setpoint_accepted_count: int = 0
    setpoint_refused_count: list[int] = field(default_factory=lambda: [0] * len(SetpointRefusal))
    """By reason, in the order of `SetpointRefusal`."""
    lapse_count: int = 0
    lapse_reason: str = ""
    """Of the newest lapse."""
    seq: int = 0
    events: list[str] = field(default_factory=list)
    progress: str = ""
    self_test_due: str = ""
    """Why a leg may not be moved before a self-test; empty if it may."""
    inputs_unseen: tuple[str, ...] = ()
    """What of hand switch and STO has not been seen to act today, where it must be."""
    utc_newest_ns: int = 0
    """The latest time that was ever read: a clock that is behind it went back."""
    axes: tuple[Axis, ...] = field(init=False)
    """All axes of all legs, in the order of the records."""

    def __post_init__(self) -> None:
        """Legs and their axes stay what they are for as long as a core lives."""
        self.axes = tuple(axis for leg in self.legs for axis in leg.axes)
