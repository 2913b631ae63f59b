"""The mutable state of the core that is kept from one cycle to the next."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from gaitd_names import Cause, EventCode, Mode, SelfTestDue, Untested

from daemon.core.core_config import CoreConfig
from daemon.core.exercises.exercise import Exercise, Reference
from daemon.core.exercises.hold import Hold
from daemon.core.exercises.single_axis import HomingRules, PushRules, Result, SingleAxis
from daemon.core.modes.persistent_state import PersistentState, PoseRules, Wiring
from daemon.core.motion.gait_shape import GaitShape
from daemon.core.period import cycles
from daemon.core.safety.clonus import ClonusWatch
from daemon.core.safety.energy import StrideSum
from daemon.core.safety.inverse_dynamics import Law
from daemon.core.safety.limits import AxisLimits
from daemon.core.safety.spasm import SpasmWatch
from daemon.core.safety.stop_sequence import DriveStop
from daemon.core.slices import (
    Assisted,
    Estimated,
    Inputs,
    LegAssist,
    Monitored,
    Passive,
    Placed,
    Sensed,
    Sent,
    Softened,
)
from daemon.ipc.record import Request, RequestResult, Verdict
from daemon.ipc.report import Event, Progress
from drives.cia402.drive import DriveGroup
from drives.cia402.torque import TorqueSampling
from drives.cia402.units import AxisScaling
from observer.filter.leg_observer import LegObserver
from observer.leg_smoother import LegSmoother
from observer.mechanism.friction import EVERYWHERE, FrictionParameters, OverPosition
from observer.mechanism.parameters import LegParameters
from observer.strides import StrideCounter

HOLD_SETTLE_CYCLES: Final = cycles(0.5)
"""Time in which a leg that was far from its reference comes to it, as at the end of a gait."""


@dataclass(slots=True)
class Axis:
    """Parameters and state of one axis."""

    name: str
    """Name as in the records, for example `right/hip`."""
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
    clonus: ClonusWatch
    reaction_cycles: int
    """Longest fault reaction of the drive, in cycles, from its profile."""
    serial_number: int = 0
    sign_proven: bool = False
    sensed: Sensed = field(default_factory=Sensed)
    stop: DriveStop | None = None
    sent: Sent = field(default_factory=Sent)
    energy: StrideSum = field(default_factory=StrideSum)
    """Energy that the drive puts into the leg, J."""
    residual: StrideSum = field(default_factory=StrideSum)
    """Sum of the effort residual over the cycles of a playing gait."""

    def is_other_drive(self, serial_number: int) -> bool:
        """True if a drive that is found now is not certainly the one of before.

        A drive without a serial number (0) cannot be told from another one once it was not watched.
        """
        return serial_number != self.serial_number or (
            serial_number == 0 and not self.sensed.watched
        )


@dataclass(frozen=True, slots=True)
class Observers:
    """The objects that estimate one leg; `steps/estimation.py` alone calls them."""

    observer: LegObserver
    smoother: LegSmoother
    strides: StrideCounter
    friction: tuple[FrictionParameters, FrictionParameters]
    """Friction of hip and slide."""
    over: tuple[OverPosition, OverPosition] = (EVERYWHERE, EVERYWHERE)
    """How friction rises along hip and slide."""
    effort_offset: tuple[float, float] = (0.0, 0.0)
    """What the drives show at no effort, N·m and N."""
    slope_std: tuple[float, float] | None = None
    """How sure `over` is of an empty machine, 1/rad and 1/m; None with a patient."""
    frictional: tuple[bool, ...] = ()
    """Which of the considered parameters are of friction."""


@dataclass(slots=True)
class Leg:
    """Parameters and state of one leg: two axes, an observer and an exercise."""

    name: str
    parameters: LegParameters
    shape: GaitShape
    axes: tuple[Axis, Axis]
    observers: Observers
    phase_offset_strides: float
    exercise: Exercise | None = None
    reference: Reference | None = None
    estimated: Estimated = field(default_factory=Estimated)
    assist: LegAssist = field(default_factory=LegAssist)
    """The setpoint of a controller and the assist in force."""
    takes_over: bool = False
    """The exercise is another one since the last command, and continues that command's effort."""
    softened: Softened = field(default_factory=Softened)
    passive: Passive = field(default_factory=Passive)
    placed: Placed = field(default_factory=Placed)
    monitored: Monitored = field(default_factory=Monitored)
    mechanism: tuple[float, ...] = field(init=False)
    """`parameters` as a plain tuple, which compiled functions read faster."""
    friction_laws: tuple[Law, Law] = field(init=False)
    """`friction` and how it rises along the axes, as plain tuples."""

    def __post_init__(self) -> None:
        """Convert the parameters for the compiled functions."""
        hip, slide = zip(self.friction, self.observers.over, strict=True)
        self.mechanism = tuple(map(float, self.parameters))
        self.friction_laws = _plain(hip), _plain(slide)

    @property
    def friction(self) -> tuple[FrictionParameters, FrictionParameters]:
        """Friction of hip and slide, as used by the observer."""
        return self.observers.friction

    @property
    def guidance_ratio(self) -> float:
        """Share of the configured guidance stiffness that is in force."""
        return self.assist.stiffness_ratio * min(
            self.softened.spasm_ratio, self.softened.clonus_ratio
        )

    @property
    def is_held(self) -> bool:
        """True if mode HOLD holds a pose, and the hold has settled.

        An exercise that has begun since this cycle's samples were taken holds nothing.
        """
        return isinstance(self.exercise, Hold) and self.placed.held_cycles > HOLD_SETTLE_CYCLES

    @property
    def is_located(self) -> bool:
        """True if the pose is known: both axes have a sample and are referenced."""
        hip, slide = self.axes
        return (
            hip.sensed.joint.known
            and hip.sensed.referenced
            and slide.sensed.joint.known
            and slide.sensed.referenced
        )


@dataclass(slots=True)
class Core:
    """The whole state of the core between two cycles."""

    boot_id: str
    config: CoreConfig
    legs: tuple[Leg, ...]
    drives: DriveGroup | None = None
    """None until the drives have been brought up, and after they were lost."""
    mode: Mode = Mode.OFF
    verdict: Verdict = field(default_factory=Verdict)
    """Latched until a reset; in mode OFF the reason why the drives are not available."""
    causes_reported: set[tuple[Cause, str]] = field(default_factory=set[tuple[Cause, str]])
    """Causes published since the machine was stopped: each is published once."""
    disabling: bool = False
    """The mode is STOPPING because of a disable request, not because of a verdict."""
    reset_cycles_left: int = 0
    """Cycles for which a requested fault reset is still tried."""
    reset_settle_cycles: int = 0
    """Cycles for which all drives must still show no fault before the reset is done."""
    load_settle_cycles: int = 0
    load_checked: bool = False
    persistent: PersistentState = field(default_factory=PersistentState)
    """The persistent state: it outlives a restart."""
    single_axis: SingleAxis | None = None
    """The homing or sign test of one axis, under way or about to begin."""
    evidence: dict[str, Result] = field(default_factory=dict[str, Result])
    """Successful sign tests by axis, until the operator confirms the observed direction."""
    request: Request | None = None
    """The request that is accepted and not finished yet."""
    result: RequestResult = field(default_factory=RequestResult)
    """Result of the newest request received: its id never decreases."""
    inputs: Inputs = field(default_factory=Inputs)
    assisted: Assisted = field(default_factory=Assisted)
    seq: int = 0
    events: list[Event] = field(default_factory=list)
    bring_up: Progress | None = None
    """The step of the bring-up; None: none runs."""
    self_test_due: SelfTestDue = SelfTestDue.NONE
    inputs_untested: tuple[tuple[str, Untested], ...] = ()
    """The axes and the states of their inputs that the daily test has still to see, if required."""
    utc_newest_ns: int = 0
    """The latest UTC time ever read: a clock that shows less was set back."""
    axes: tuple[Axis, ...] = field(init=False)
    """All axes of all legs, in the order of the records."""

    def __post_init__(self) -> None:
        """Collect the axes; legs and axes are the same objects for the life of a core."""
        self.axes = tuple(axis for leg in self.legs for axis in leg.axes)

    def report(
        self, code: EventCode, subject: str = "", *values: float | str, said: str = ""
    ) -> None:
        """Publish an event with one of the next records; see `Event`."""
        self.publish([Event(code, subject, values, said)])

    def publish(self, events: Iterable[Event]) -> None:
        """Publish events with one of the next records."""
        self.events.extend(events)


def _plain(friction: tuple[FrictionParameters, OverPosition]) -> Law:
    law, over = friction
    return tuple(map(float, law)), tuple(map(float, over))
