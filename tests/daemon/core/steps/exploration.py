"""The core's steps explored breadth first: every state that one event leads to, and two at once.

The core runs without bus, observer and record. A drive obeys the last request, unless an event of
the cycle says otherwise: it shows another power state, its sample is missing, it moves, a verdict
is found, a request arrives, an alarm comes between two windows, the bus is lost, time has passed.

Times are collapsed (`SHORT`): a state is what the steps decide by, not how long it has lasted. An
exercise stands still until its stage ends, and a stop until its longest time is over (LATER).
"""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache
from itertools import combinations
from types import SimpleNamespace
from typing import NamedTuple

import msgspec
from fresh_core import has_been_sent, show
from gaitd_names import AxisStep, Cause, EventCode, Mode, RequestKind, Role, StopCategory
from safety_inputs import FEEDBACK, JOINT
from sessions import demo

from daemon.core.exercises.single_axis import HomingRules
from daemon.core.modes.persistent_state import PersistentState
from daemon.core.runtime.build import build
from daemon.core.safety import checks
from daemon.core.safety.joints import Joint
from daemon.core.safety.stop_sequence import Step
from daemon.core.slices import Assisted, Inputs
from daemon.core.state import Core
from daemon.core.steps import (
    checking,
    exercises,
    impedance,
    sensing,
    single_axis,
    supervisor,
    wanted,
)
from daemon.ipc.record import ModeRequest, Request, RequestResult, Verdict
from drives.cia402.power_state import STATUS_HOMING_ATTAINED, STATUS_TARGET_REACHED
from drives.signals import DriveFeedback, OperationMode, PowerRequest, PowerState

SETTINGS = demo()
NOW = 10_000
HEARD = Inputs(gateway_state_cycle=NOW, lease=7)
"""The cycle of every transition: ages are kept, and times are counted back from here."""
AGE_MAX = 1
"""Cycles without a sample after which a drive is silent."""
LONG = 1_000
SHORT = {
    (supervisor, "LOAD_SETTLE_CYCLES"): 1,
    (supervisor, "RESET_CYCLES"): 2,
    (supervisor, "RESET_SETTLE_CYCLES"): 1,
    (supervisor, "STOPPING_MAX_CYCLES"): LONG // 2,
    (single_axis, "BEGIN_CYCLES"): LONG // 2,
    (checks, "ENABLE_CYCLES"): 1,
}
"""Times of the core as they are in a search."""
HIP, SLIDE = 0, 1
AT_REST = JOINT._replace(position_si=0.2, velocity_si=0.0, effort_si=0.0, still_cycles=LONG)
FAST_SI = 1.0
"""More than a hold may move, less than the speed limits."""
OFF, ON = PowerState.SWITCH_ON_DISABLED, PowerState.SWITCHED_ON
ENABLED, BRAKING = PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE
REACTING, FAULT = PowerState.FAULT_REACTION_ACTIVE, PowerState.FAULT
UNKNOWN = PowerState.UNKNOWN
POWERED = frozenset({ENABLED, BRAKING})
ENABLING = frozenset({PowerRequest.ENABLE, PowerRequest.HOME})
DRIVES = SimpleNamespace(bus_state=SimpleNamespace(has_been_off=False))
TICK = SimpleNamespace(
    cycle=NOW, shutdown=False, overruns_in_a_row=0, bus_error="", tx_dropped_in_a_row=0
)


# --- events ---------------------------------------------------------------------------------------


class Kind(Enum):
    """What an event is about; of one kind and one axis only one comes in a cycle."""

    SHOWS = "shows"
    NO_SAMPLE = "no sample"
    MOVES = "moves"
    VERDICT = "verdict"
    REQUEST = "request"
    STOP = "stop requested"
    BETWEEN = "alarm between two windows"
    BUS_LOST = "bus lost"
    BRING_UP = "bring-up"
    LATER = "later"


class Event(NamedTuple):
    """Something that happens in a cycle."""

    kind: Kind
    axis: int = -1
    what: object = None

    def __str__(self) -> str:
        """Its name, for the report of a violation."""
        what = getattr(self.what, "name", self.what)
        if self.kind is Kind.REQUEST and isinstance(self.what, tuple):
            kind, wanted_mode = self.what
            what = wanted_mode.mode.name if kind is RequestKind.MODE else kind.name
        return f"{self.kind.value} {('', 'hip', 'slide')[self.axis + 1]} {what or ''}".strip()


def _mode(mode: Mode, **more: object) -> tuple[RequestKind, ModeRequest]:
    return RequestKind.MODE, ModeRequest(mode, **more)


SHOWS = tuple(
    Event(Kind.SHOWS, axis, state)
    for axis in (HIP, SLIDE)
    for state in (OFF, ON, ENABLED, BRAKING, REACTING, FAULT, UNKNOWN)
)
NO_SAMPLE = tuple(Event(Kind.NO_SAMPLE, axis) for axis in (HIP, SLIDE))
MOVES = tuple(Event(Kind.MOVES, axis) for axis in (HIP, SLIDE))
BETWEEN = tuple(Event(Kind.BETWEEN, axis) for axis in (HIP, SLIDE))
WORLD = (*SHOWS, *NO_SAMPLE, *MOVES, *BETWEEN, Event(Kind.BUS_LOST), Event(Kind.LATER))
REQUESTS = tuple(
    Event(Kind.REQUEST, what=one)
    for one in (
        (RequestKind.ENABLE, ModeRequest()),
        (RequestKind.DISABLE, ModeRequest()),
        (RequestKind.RESET, ModeRequest()),
        _mode(Mode.HOLD),
        _mode(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=10.0),
        _mode(Mode.TORQUE),
        _mode(Mode.EXCITE, duration_s=5.0, scenario=next(iter(SETTINGS.trainer.excite))),
        _mode(Mode.HAND_GUIDING),
        _mode(Mode.SELF_TEST),
        _mode(Mode.REFERENCE, axis="right/hip"),
        _mode(Mode.COMMISSION, axis="right/hip"),
    )
)
STOP = Event(Kind.STOP)
VERDICTS = tuple(
    Event(Kind.VERDICT, axis, cause)
    for cause, axes in (
        (Cause.GATEWAY_SILENT, (-1,)),
        (Cause.CYCLE_OVERRUN, (-1,)),
        (Cause.SHUTDOWN, (-1,)),
        (Cause.TRACKING_LIMIT, (HIP,)),
        (Cause.HAND_SWITCH_OPEN, (HIP,)),
        (Cause.STO_ACTIVE, (HIP,)),
        (Cause.ENCODER_JUMP, (HIP, SLIDE)),
        (Cause.HEARTBEAT_LOST, (HIP, SLIDE)),
    )
    for axis in axes
)
"""S2, S1 and S0 of the service and of an axis; doubtful feedback; a lost drive."""
RESTING_CAUSES = frozenset({Cause.HEARTBEAT_LOST})
"""Causes of VERDICTS that are found without power as well."""
BEGIN, UP, HELD, ABSENT = (
    Event(Kind.BRING_UP, what=what) for what in ("begins", "done", "holds power", "silent")
)
NOTHING: tuple[Event, ...] = ()


ALIKE = frozenset(
    event
    for event in (*SHOWS, *VERDICTS, *REQUESTS)
    if event.what in {ON, Cause.CYCLE_OVERRUN, Cause.TRACKING_LIMIT}
    or (event.kind is Kind.REQUEST and event.what[1].mode in {Mode.EXCITE, Mode.SELF_TEST})
)
"""Events that differ little from another one: in pairs a small search leaves them out."""
ORDER = {event: number for number, event in enumerate((*WORLD, *VERDICTS, *REQUESTS, STOP))}


# --- states ---------------------------------------------------------------------------------------

CORE_FIELDS = (
    "drives",
    "mode",
    "verdict",
    "disabling",
    "reset_cycles_left",
    "reset_settle_cycles",
    "load_settle_cycles",
    "load_checked",
    "persistent",
    "single_axis",
    "request",
    "result",
    "assisted",
)
LEG_FIELDS = ("exercise", "reference", "takes_over")
AXIS_FIELDS = ("sensed", "stop", "sent")


class Trace(NamedTuple):
    """What the search knows beside the core: power that was requested, and what drives showed."""

    permitted: bool = False
    """A request to enable is in force."""
    words: tuple[PowerRequest | None, ...] = (None, None)
    """The last power request to each drive."""
    off_seen: tuple[bool, bool] = (True, True)
    """The drive has shown that it is off since the last enabling word."""
    unasked: tuple[int, int] = (0, 0)
    """Cycles with power that no word asks for, without a stop."""
    asked: tuple[bool, bool] | None = None
    """`permitted` and before it, of the enabling request that is not answered yet."""


TOLD_APART = frozenset({Cause.STOP_NOT_OBEYED, Cause.SHUTDOWN, Cause.DRIVE_POWERED})
"""Causes with rules of their own; all others differ by their category alone."""


class State(NamedTuple):
    """A state of core and search, and how it was reached."""

    core: tuple[object, ...]
    trace: Trace
    key: tuple[object, ...]
    number: int = 0
    parent: "State | None" = None
    events: tuple[Event, ...] = NOTHING

    @property
    def axes_alike(self) -> bool:
        """Both axes are in the same state, and none of them is moved alone."""
        hip, slide = self.key[-1] or (0, 1)
        return hip == slide and self.core[CORE_FIELDS.index("single_axis")] is None

    @property
    def mode(self) -> Mode:
        """The mode of the core."""
        mode = self.core[1]
        assert isinstance(mode, Mode)
        return mode


class Seen(NamedTuple):
    """One transition, for the invariants."""

    before: "Facts"
    after: "Facts"
    events: tuple[Event, ...]
    accepted: Request | None
    found: tuple[Verdict, ...]
    driving: bool
    """A drive had power by the core's request when the verdicts were found."""
    bus_lost: bool


class Facts(NamedTuple):
    """What the invariants read of a state."""

    mode: Mode
    verdict: Verdict
    stops: tuple[Step | None, ...]
    shown: tuple[PowerState | None, ...]
    fresh: tuple[bool, ...]
    has_drives: bool
    latched: str
    trace: Trace


class BrokenError(AssertionError):
    """An invariant does not hold; the message tells the way there."""


def _feedback(node_id: int) -> Callable[..., DriveFeedback]:
    made: dict[tuple[object, ...], DriveFeedback] = {}

    def feedback(state: PowerState, age: int, mode: OperationMode, homed: bool) -> DriveFeedback:
        key = state, age, mode, homed
        if key not in made:
            reached = STATUS_TARGET_REACHED | STATUS_HOMING_ATTAINED if homed else 0
            made[key] = FEEDBACK._replace(
                node_id=node_id,
                power_state=state,
                statusword=reached,
                mode_display=mode,
                fresh=age == 0,
                sample_age_cycles=age,
            )
        return made[key]

    return feedback


class Model:
    """One core that is set to a state, run for a cycle, and read again."""

    def __init__(self) -> None:
        core = self.core = build(SETTINGS, "search", PersistentState()).core
        thresholds = core.config.thresholds._replace(
            sample_age_max_cycles=AGE_MAX, mode_switch_cycles=1, gateway_silence_cycles=LONG
        )
        rules = core.config.stop_rules._replace(obey_cycles=1, standstill_cycles=2)
        core.config = replace(
            core.config,
            thresholds=thresholds,
            stop_rules=rules,
            patient_configured=False,
            signs_must_be_proven=False,
        )
        core.inputs = HEARD
        for axis in core.axes:
            axis.limits = axis.limits._replace(
                enable_max_cycles=3, static_load_tolerance_si=1e6, tracking_max_si=1e6
            )
            axis.reaction_cycles = 1
            show(axis, referenced=True)
            axis.homing = HomingRules(5.0, 10.0, LONG // 2)
        self._feedback = [_feedback(axis.node_id) for axis in core.axes]

    # --- a state in and out ---------------------------------------------------------------------

    def power_on(self) -> State:
        """The state before the first bring-up."""
        return self.read(Trace())

    def set(self, state: State) -> None:
        """Put the core into a state."""
        core, values = self.core, iter(state.core)
        for name in CORE_FIELDS:
            setattr(core, name, next(values))
        for leg in core.legs:
            for name in LEG_FIELDS:
                setattr(leg, name, next(values))
        for axis in core.axes:
            for name in AXIS_FIELDS:
                setattr(axis, name, next(values))
        core.evidence, core.causes_reported, core.events = {}, set(), []

    def read(self, trace: Trace) -> State:
        """The state in which the core is, with all times made short and counted back."""
        core = self.core
        self._normalise()
        values = [getattr(core, name) for name in CORE_FIELDS]
        values += [getattr(leg, name) for leg in core.legs for name in LEG_FIELDS]
        values += [getattr(axis, name) for axis in core.axes for name in AXIS_FIELDS]
        return State(tuple(values), trace, self._key(trace))

    def _normalise(self) -> None:
        core = self.core
        verdict, latched = core.verdict, core.persistent.latched
        core.verdict = Verdict(verdict.category, verdict.cause, verdict.drive)
        if latched is not None:
            core.persistent = PersistentState(
                latched=type(latched)(latched.category, latched.cause)
            )
        elif core.persistent != PersistentState():
            core.persistent = PersistentState()
        core.load_settle_cycles = min(core.load_settle_cycles, 2)
        if core.request is not None:
            core.request = msgspec.structs.replace(core.request, id=1, for_cycle=NOW)
            core.result = RequestResult(1)
        else:
            core.result = RequestResult()
        core.assisted = Assisted(core.assisted.torque_lease, core.assisted.cap_si)
        run = core.single_axis
        if run is not None:
            core.single_axis = replace(run, cycles=0, requested_cycle=NOW, effort_si=0.0)
        for leg in core.legs:
            if leg.exercise is not None:
                leg.exercise = replace(leg.exercise, elapsed_s=0.0)
                if hasattr(leg.exercise, "strides"):
                    leg.exercise = replace(leg.exercise, strides=0.0, end_strides=0.0)
        for axis in core.axes:
            stop = axis.stop
            if stop is not None:
                axis.stop = stop._replace(
                    since_cycle=NOW - 1 - min(NOW - stop.since_cycle, 1),
                    ramp_speed_si=0.0,
                    at_rest_cycles=min(stop.at_rest_cycles, 2),
                    unproven_cycles=min(stop.unproven_cycles, 2),
                )
            show(
                axis,
                unready_cycles=min(axis.sensed.unready_cycles, 5),
                unexpected_enable_cycles=min(axis.sensed.unexpected_enable_cycles, 3),
            )

    def _key(self, trace: Trace) -> tuple[object, ...]:
        """What tells two states apart. The axes are alike, unless one of them is moved alone."""
        core, run, request = self.core, self.core.single_axis, self.core.request
        verdict, latched = core.verdict, core.persistent.latched
        axes: tuple[object, ...] = ()
        exercise: tuple[object, ...] = ()
        if core.drives is not None:  # else the next bring-up begins with axes at rest
            axes = tuple(
                (self._axis_key(number), trace.words[number], trace.unasked[number])
                for number in range(len(core.axes))
            )
            exercise = tuple(
                (type(leg.exercise), leg.exercise and leg.exercise.stage) for leg in core.legs
            )
        return (
            core.drives is not None,
            core.mode,
            verdict.category,
            verdict.cause if verdict.cause in TOLD_APART else verdict.cause != Cause.NONE,
            core.disabling,
            core.reset_cycles_left,
            core.reset_settle_cycles,
            core.load_settle_cycles,
            core.load_checked,
            latched is not None,
            run and (run.mode, run.step),
            request and (request.kind, request.mode.mode),
            exercise,
            trace.permitted,
            trace.asked,
            axes if run is not None else tuple(sorted(axes, key=hash)),
        )

    def _axis_key(self, number: int) -> tuple[object, ...]:
        axis = self.core.axes[number]
        feedback, stop = axis.sensed.feedback, axis.stop
        if feedback is None:
            return (stop,)
        state, age = feedback.power_state, feedback.sample_age_cycles
        if stop is None:
            ready = (
                axis.sensed.reached_enabled,
                axis.sensed.unready_cycles,
                axis.sensed.unexpected_enable_cycles,
            )
            return state, age, axis.sensed.shown_unpowered, axis.sent.mode, *ready
        # A stop goes on whatever was before it, and all states without torque are alike to it.
        rest_cycles = stop.at_rest_cycles if self.core.mode == Mode.STOPPING else 0
        times = NOW - stop.since_cycle, rest_cycles, stop.has_rested, stop.unproven_cycles
        return OFF if state is ON else state, age, axis.sensed.shown_unpowered, stop.step, *times

    def facts(self, trace: Trace) -> Facts:
        """What the invariants read."""
        core, axes = self.core, self.core.axes
        latched = core.persistent.latched
        return Facts(
            core.mode,
            core.verdict,
            tuple(axis.stop and axis.stop.step for axis in axes),
            tuple(axis.sensed.feedback and axis.sensed.feedback.power_state for axis in axes),
            tuple(axis.sensed.joint.fresh for axis in axes),
            core.drives is not None,
            latched.cause if latched is not None else "",
            trace,
        )

    def class_of(self, state: State) -> tuple[object, ...]:
        """What states have in common that differ in counters and in what the drives show."""
        self.set(state)
        core = self.core
        return (
            *self.pair_class_of(state),
            core.drives is not None,
            core.disabling,
            core.load_checked,
            core.reset_cycles_left > 0,
            core.request and core.request.kind,
        )

    def pair_class_of(self, state: State) -> tuple[object, ...]:
        """The wider class, for pairs of events: mode, stage, harshest stop, step of one axis."""
        self.set(state)
        core, run, leg = self.core, self.core.single_axis, self.core.legs[0]
        steps = [axis.stop.step for axis in core.axes if axis.stop is not None]
        stage = leg.exercise and leg.exercise.stage
        return core.mode, core.load_checked, stage, max(steps, default=None), run and run.step

    # --- a cycle --------------------------------------------------------------------------------

    def run(self, state: State, events: tuple[Event, ...]) -> tuple[State, Seen]:
        """The state after a cycle with these events."""
        self.set(state)
        core, trace = self.core, state.trace
        before = self.facts(trace)
        orders = core.inputs = _orders(events)
        lost = any(one.kind is Kind.BUS_LOST for one in events)
        found: tuple[Verdict, ...] = ()
        driving = wanted.is_driving(core)
        if any(one.kind is Kind.LATER for one in events):
            self._let_pass()
        if lost:
            supervisor.lose_bus(core, "gone")
        shown_off = trace.off_seen
        if core.drives is None:
            supervisor.rest(core, NOW, 0)
            self._bring_up(events)
            words: tuple[PowerRequest | None, ...] = (None, None)
        else:
            alarmed = self._between(events, driving=driving)
            self._sense(state, events, alarmed)
            driving = wanted.is_driving(core)
            found = self._found(events)
            supervisor.supervise(core, found, NOW, 0)
            # The cycle in which the drives are dropped sends nothing any more.
            words = self._command() if core.drives is not None else (None, None)
            off = (OFF, FAULT)
            shown_off = tuple(
                seen or axis.sensed.feedback.power_state in off
                for seen, axis in zip(shown_off, core.axes, strict=True)
            )
        accepted = _accepted(core, orders.request)
        trace = self._traced(trace, accepted, orders, found, driving=driving, lost=lost)
        trace = trace._replace(unasked=self._unasked(trace))
        after = self.facts(trace._replace(words=words, off_seen=shown_off))
        seen = Seen(before, after, events, accepted, found, driving, lost)
        trace = self._answered(trace, seen, words)
        off_seen = tuple(
            off and word not in ENABLING for off, word in zip(shown_off, words, strict=True)
        )
        return self.read(trace._replace(words=words, off_seen=off_seen)), seen

    def _unasked(self, trace: Trace) -> tuple[int, int]:
        """Cycles in a row in which each drive has power that it was not told to have."""
        hip, slide = (
            min(number + 1, 4)
            if axis.sensed.feedback is not None
            and axis.sensed.feedback.power_state in POWERED
            and axis.stop is None
            and word not in ENABLING
            else 0
            for number, word, axis in zip(trace.unasked, trace.words, self.core.axes, strict=True)
        )
        return hip, slide

    def _let_pass(self) -> None:
        """A stage, a stop's longest time, or the time of a homing or sign test is over."""
        core, run = self.core, self.core.single_axis
        for leg in core.legs:
            if leg.exercise is not None:
                leg.exercise = replace(leg.exercise, elapsed_s=1e6)
                if hasattr(leg.exercise, "strides"):
                    leg.exercise = replace(leg.exercise, strides=2.0)
        for axis in core.axes:
            if axis.stop is not None:
                axis.stop = axis.stop._replace(since_cycle=NOW - LONG)
        if run is not None:
            core.single_axis = replace(run, requested_cycle=NOW - LONG)
            if run.step in {AxisStep.FORTH, AxisStep.BACK}:
                core.single_axis = replace(core.single_axis, cycles=LONG * LONG)
            elif run.step in {AxisStep.RESTING, AxisStep.ENDING}:
                core.single_axis = replace(core.single_axis, rest_cycles=LONG)

    def _between(self, events: tuple[Event, ...], *, driving: bool) -> dict[int, PowerState]:
        """A fault that a drive reports between two windows stops the machine at once."""
        alarmed = {one.axis: REACTING for one in events if one.kind is Kind.BETWEEN}
        for number in alarmed:
            axis = self.core.axes[number]
            if axis.sensed.feedback is None:
                continue
            show(axis, feedback=axis.sensed.feedback._replace(power_state=REACTING))
            if driving:
                verdict = Verdict(StopCategory.S1, Cause.DRIVE_FAULT, axis.name)
                supervisor.stop(self.core, verdict, NOW)
        return alarmed

    def _sense(
        self, state: State, events: tuple[Event, ...], alarmed: Mapping[int, PowerState]
    ) -> None:
        core = self.core
        shows = {one.axis: one.what for one in events if one.kind is Kind.SHOWS}
        silent = {one.axis for one in events if one.kind is Kind.NO_SAMPLE}
        moving = {one.axis for one in events if one.kind is Kind.MOVES}
        later = any(one.kind is Kind.LATER for one in events)
        for number, axis in enumerate(core.axes):
            last = axis.sensed.feedback
            shown = OFF if last is None else last.power_state
            obeyed = alarmed.get(number) or _obeys(shown, state.trace.words[number])
            age = 0 if number not in silent else min((last.sample_age_cycles if last else 0) + 1, 2)
            power = shows.get(number, obeyed)
            run = core.single_axis
            homed = later and run is not None and run.searching
            feedback = self._feedback[number](power, age, axis.sent.mode, homed)
            speed_si = FAST_SI if number in moving else 0.0
            joint = AT_REST._replace(velocity_si=speed_si) if age == 0 else axis.sensed.joint
            now = sensing.inputs_of(core, axis, feedback)
            readiness = sensing._readiness(axis.sensed, feedback, now)
            joint = joint._replace(fresh=age == 0)
            show(axis, feedback=feedback, joint=joint, **readiness._asdict())

    def _found(self, events: tuple[Event, ...]) -> tuple[Verdict, ...]:
        """What the checks find, and what the events say that they find."""
        core = self.core
        found = {one.drive: one for one in checks.check_raw(checking.safety_inputs(core, TICK))}
        for event in events:
            if event.kind is not Kind.VERDICT:
                continue
            cause = event.what
            if not (wanted.is_driving(core) or cause in RESTING_CAUSES):
                continue
            name = core.axes[event.axis].name if event.axis >= 0 else ""
            verdict = Verdict(core.config.categories.of(cause), cause, name)
            if verdict.category.severity > found.get(name, checks.NO_VERDICT).category.severity:
                found[name] = verdict
        return tuple(sorted(found.values(), key=lambda verdict: -verdict.category.severity))

    def _command(self) -> tuple[PowerRequest, ...]:
        core = self.core
        for axis, request in zip(core.axes, impedance.requests(core), strict=True):
            has_been_sent(axis, mode=request.mode)
        return tuple(impedance._power(core, axis) for axis in core.axes)

    def _bring_up(self, events: tuple[Event, ...]) -> None:
        """One step of the bring-up, in the absence of drives; by default it succeeds."""
        core = self.core
        said = next((one for one in events if one.kind is Kind.BRING_UP), None)
        if core.mode == Mode.OFF:
            supervisor.begin_bring_up(core)
        elif core.mode == Mode.BRINGING_UP and said is HELD and core.reset_cycles_left == 0:
            supervisor.wait_for_reset(core, core.axes[HIP].name, ENABLED)
        elif core.mode == Mode.BRINGING_UP and said is ABSENT:
            supervisor.fail_bring_up(core, Cause.DRIVE_SILENT, core.axes[HIP].name, "silent")
        elif core.mode == Mode.BRINGING_UP and said is None:
            for axis in core.axes:
                show(
                    axis,
                    joint=Joint(),
                    feedback=None,
                    reached_enabled=False,
                    unready_cycles=0,
                    unexpected_enable_cycles=0,
                    shown_unpowered=True,
                )
                has_been_sent(axis, mode=OperationMode.CYCLIC_SYNC_TORQUE)
            exercises.reset(core)
            supervisor.take_drives(core, DRIVES)

    # --- the request in force -------------------------------------------------------------------

    def _traced(
        self,
        trace: Trace,
        accepted: Request | None,
        orders: Inputs,
        found: tuple[Verdict, ...],
        *,
        driving: bool,
        lost: bool,
    ) -> Trace:
        """Whether a request to enable is in force after the events of this cycle."""
        permitted = trace.permitted and not (orders.stop or lost or (driving and found))
        if accepted is None:
            return trace._replace(permitted=permitted)
        alone = accepted.mode.mode in {Mode.REFERENCE, Mode.COMMISSION}
        if accepted.kind == RequestKind.ENABLE or (accepted.kind == RequestKind.MODE and alone):
            return trace._replace(permitted=True, asked=(True, permitted))
        ends = accepted.kind in {RequestKind.DISABLE, RequestKind.RESET}
        return trace._replace(permitted=permitted and not ends)

    def _answered(self, trace: Trace, seen: Seen, words: tuple[PowerRequest | None, ...]) -> Trace:
        """A refused request permits nothing; an enabling word that ends needs another request."""
        core = self.core
        if trace.asked is not None and core.request is None:
            refused = _has_reported(core, EventCode.REQUEST_REFUSED)
            permitted = trace.permitted and (not refused or trace.asked[1])
            trace = trace._replace(permitted=permitted, asked=None)
        ended = any(
            last in ENABLING and word not in ENABLING
            for last, word in zip(seen.before.trace.words, words, strict=True)
        )
        return trace._replace(permitted=trace.permitted and not ended)


def _orders(events: tuple[Event, ...]) -> Inputs:
    stop = any(one.kind is Kind.STOP for one in events)
    request = next((one.what for one in events if one.kind is Kind.REQUEST), None)
    if request is None:
        return msgspec.structs.replace(HEARD, stop=stop)
    request = Request(2, request[0], NOW, request[1], Role.UNRESTRICTED)
    return msgspec.structs.replace(HEARD, stop=stop, request=request)


def _has_reported(core: Core, code: EventCode) -> bool:
    return any(event.code is code for event in core.events)


def _accepted(core: Core, request: Request | None) -> Request | None:
    return request if _has_reported(core, EventCode.REQUEST_RECEIVED) else None


def _obeys(shown: PowerState, word: PowerRequest | None) -> PowerState:
    """The state that a drive shows next if it does what it was told."""
    if shown in {REACTING, FAULT}:
        return OFF if word is PowerRequest.FAULT_RESET and shown is FAULT else FAULT
    if word in ENABLING:
        return {OFF: ON, BRAKING: BRAKING}.get(shown, ENABLED)
    if word is PowerRequest.QUICK_STOP:
        return BRAKING if shown in {ENABLED, BRAKING, UNKNOWN} else OFF
    return OFF


# --- invariants -----------------------------------------------------------------------------------

STOPPED = frozenset({Mode.STOPPING, Mode.FAULT})
NOT_LATCHED = frozenset({Cause.NONE, Cause.SHUTDOWN, Cause.DRIVE_POWERED})
"""Causes that are not kept over a restart."""
FIRST_STEP = {
    StopCategory.S2: Step.HOLD,
    StopCategory.S1: Step.QUICK_STOP,
    StopCategory.S0: Step.DISABLE,
}

UNASKED_MAX = SHORT[checks, "ENABLE_CYCLES"] + 2
"""Cycles in which a drive may show power after its enabling word has ended."""


def broken(seen: Seen) -> Iterator[str]:
    """The invariants of the random sessions that a transition violates, each as a sentence."""
    yield from _enabling(seen)
    yield from _latching(seen)
    yield from _checked(seen)
    yield from _unrequested_power(seen)


def _enabling(seen: Seen) -> Iterator[str]:
    before, after = seen.before.trace.words, seen.after.trace
    for number, word in enumerate(after.words):
        if word in ENABLING and before[number] not in ENABLING and not after.permitted:
            yield f"axis {number} is enabled without a request in force"
        if word in ENABLING and (seen.after.stops[number] or Step.HOLD) > Step.HOLD:
            yield f"axis {number} is stopped, and told to enable"
    words = set(after.words)
    apart = words & ENABLING and words - ENABLING
    ended = any(
        last in ENABLING and word not in ENABLING
        for last, word in zip(before, after.words, strict=True)
    )
    if apart and ended:
        yield "one axis is stopped, and the other one is still enabled"


def _latching(seen: Seen) -> Iterator[str]:
    before, after = seen.before, seen.after
    reset = seen.accepted is not None and seen.accepted.kind == RequestKind.RESET
    # A stop ends in FAULT when the bus is lost, before requests are read.
    if reset and before.mode not in {Mode.FAULT, Mode.READY} and not seen.bus_lost:
        yield f"a reset is executed in {before.mode.name}"
    stops = after.stops
    if after.mode == Mode.STOPPING and None in stops:
        yield "stopping, and an axis has no stop"
    if any(stops) and None in stops:
        yield "one axis has a stop, the other one has none"
    if after.mode.active and any(one is not None for one in stops):
        yield f"a stop in mode {after.mode.name}"
    if max((one or Step.HOLD for one in stops), default=Step.HOLD) > Step.HOLD and (
        Step.HOLD in stops
    ):
        yield "one axis holds while the other one is stopped harder"
    if before.mode not in STOPPED or reset:
        return
    verdict = before.verdict
    stays = after.mode in STOPPED
    if verdict.cause != Cause.NONE and not stays:
        yield f"{verdict.cause.name} is left for {after.mode.name} without a reset"
    if stays and after.verdict.category.severity < verdict.category.severity:
        yield f"{verdict.category.name} becomes {after.verdict.category.name}"
    if stays and not seen.bus_lost:
        for number, (was, now) in enumerate(zip(before.stops, after.stops, strict=True)):
            if was is not None and (now is None or now < was):
                yield f"the stop of axis {number} goes back from {was.name}"
    if (
        after.mode in STOPPED
        and after.verdict.cause not in NOT_LATCHED | {verdict.cause}
        and (after.latched != after.verdict.cause)
    ):
        yield f"{after.verdict.cause.name} is not in the state file"


def _checked(seen: Seen) -> Iterator[str]:
    before, after = seen.before, seen.after
    begins = after.mode.active and not before.mode.active
    asks = seen.accepted is not None and (
        seen.accepted.kind == RequestKind.ENABLE
        or seen.accepted.mode.mode in {Mode.REFERENCE, Mode.COMMISSION}
    )
    if (begins or asks) and not all(after.fresh):
        yield "power is requested without a sample of this cycle of every axis"
    # A drive that has not been seen off since its last enabling word may still execute it.
    powered = any(
        off and shown in POWERED
        for off, shown in zip(before.trace.off_seen, after.shown, strict=True)
    )
    faulty = set(after.shown) & {FAULT, REACTING}
    if (begins or asks) and (seen.found or powered or faulty):
        yield "power is requested in the cycle of a verdict, or of a drive in fault or with power"
    reset = seen.accepted is not None and seen.accepted.kind == RequestKind.RESET
    if seen.driving and seen.found and not reset and not seen.bus_lost:
        if after.mode not in STOPPED or after.verdict.cause == Cause.NONE:
            yield f"{seen.found[0].cause.name} is found, and the mode is {after.mode.name}"
            return
        # A shutdown stops, and never replaces the cause of an earlier stop.
        earlier = before.mode in STOPPED and before.verdict.cause != Cause.NONE
        for one in seen.found:
            shutdown = one.cause == Cause.SHUTDOWN and earlier
            if after.verdict.category.severity < one.category.severity and not shutdown:
                yield f"{one.category.name} is found, {after.verdict.category.name} is latched"
        for one in seen.found:
            yield from _stopped_by(one, after)


def _stopped_by(verdict: Verdict, after: Facts) -> Iterator[str]:
    least = FIRST_STEP[verdict.category]
    for number, step in enumerate(after.stops):
        name = ("right/hip", "right/slide")[number]
        own = verdict.drive == name
        expected = least
        if verdict.cause == Cause.HEARTBEAT_LOST and own:
            expected = Step.NMT_STOP
        if verdict.cause == Cause.ENCODER_JUMP and not own:
            expected = Step.QUICK_STOP
        if step is None or step < expected:
            yield f"{verdict.cause.name} is found, and axis {number} is not stopped by it"


def _unrequested_power(seen: Seen) -> Iterator[str]:
    before, after = seen.before, seen.after
    if not (before.has_drives and after.has_drives):
        return
    for number, (shown, word, off) in enumerate(
        zip(after.shown, before.trace.words, before.trace.off_seen, strict=True)
    ):
        appears = off and word is not None and word not in ENABLING and shown in POWERED
        if appears and after.mode not in STOPPED:
            yield f"axis {number} has power without a request, and the mode is {after.mode.name}"
        if after.trace.unasked[number] > UNASKED_MAX:
            yield f"axis {number} keeps power that no request asks for, in {after.mode.name}"
        if appears and set(after.trace.words) & ENABLING:
            yield f"axis {number} has power without a request, and a drive is enabled"


# --- the search -----------------------------------------------------------------------------------


@dataclass
class Search:
    """All states that events lead to, from the state before the first bring-up."""

    model: Model = field(default_factory=Model)
    states: dict[tuple[object, ...], State] = field(default_factory=dict)
    classes: Counter[tuple[object, ...]] = field(default_factory=Counter)
    """Number of states by class."""
    pair_classes: Counter[tuple[object, ...]] = field(default_factory=Counter)
    """Number of explored states without a pending request, by their wider class."""
    transition_count: int = 0
    next_of: dict[tuple[object, ...], State] = field(default_factory=dict)
    """The state after a cycle without events."""
    stopped: dict[tuple[object, ...], State] = field(default_factory=dict)
    """The state after a stop was requested."""

    def run(
        self,
        per_class: int | None = None,
        *,
        pairs_per_class: int = 0,
        pairs_every: int = 1,
        left_out: frozenset[Event] = ALIKE,
    ) -> None:
        """Explore breadth first; a class is what `class_of` tells apart.

        Args:
            per_class: number of states of a class that are explored; None: all.
            pairs_per_class: number of states of a wider class in which two events at once are
                tried as well.
            pairs_every: one of so many pairs is tried in a state, other ones in the next class.
            left_out: events that are in no pair.

        Raises:
            BrokenError: an invariant does not hold.
        """
        start = self.model.power_on()
        self.states[start.key] = start
        waiting = deque([start])
        while waiting:
            state = waiting.popleft()
            name = self.model.class_of(state)
            self.classes[name] += 1
            if per_class is not None and self.classes[name] > per_class:
                continue
            few = self.model.pair_class_of(state)
            self.pair_classes[few] += core_waits(state)
            in_pairs = core_waits(state) and self.pair_classes[few] <= pairs_per_class
            for number, events in enumerate(choices(state, in_pairs=in_pairs, left_out=left_out)):
                if len(events) > 1 and (number + len(self.pair_classes)) % pairs_every:
                    continue
                after = self._step(state, events)
                if after.key not in self.states:
                    self.states[after.key] = after
                    waiting.append(after)

    def _step(self, state: State, events: tuple[Event, ...]) -> State:
        self.transition_count += 1
        try:
            after, seen = self.model.run(state, events)
        except Exception as bug:
            raise BrokenError(f"{type(bug).__name__}: {bug}\n{way(state, events)}") from bug
        reasons = list(broken(seen))
        if reasons:
            raise BrokenError(f"{'; '.join(reasons)}\n{way(state, events)}")
        if not events:
            self.next_of[state.key] = after
        elif events == (STOP,):
            self.stopped[state.key] = after
        return after._replace(parent=state, events=events)

    def check_ends(self) -> None:
        """After a stop and no more events every explored state comes to FAULT or READY.

        Raises:
            BrokenError: one does not.
        """
        ends: set[tuple[object, ...]] = set()
        for key, first in self.stopped.items():
            state, passed = first, [first.key]
            while state.mode not in {Mode.FAULT, Mode.READY} and state.key not in ends:
                after = self.next_of.get(state.key) or self._step(state, NOTHING)
                if after.key in passed:
                    raise BrokenError(f"no end after a stop\n{way(self.states[key], (STOP,))}")
                state = after
                passed.append(state.key)
            ends.update(passed)


def core_waits(state: State) -> bool:
    """True if no request is pending: a request may come, which would be refused otherwise."""
    return state.core[CORE_FIELDS.index("request")] is None


def choices(
    state: State, *, in_pairs: bool, left_out: frozenset[Event]
) -> Iterator[tuple[Event, ...]]:
    """No event, each event alone, and two events that can come in one cycle."""
    yield NOTHING
    events = (*REQUESTS, STOP, Event(Kind.BUS_LOST))
    if state.core[0] is not None:
        events = (*WORLD, *VERDICTS, *REQUESTS, STOP)
    elif state.mode == Mode.BRINGING_UP:
        events = (*events, HELD, ABSENT)
    alike = state.axes_alike
    for event in events:
        if not (alike and _is_mirrored((event,))):
            yield (event,)
    if in_pairs:
        for one, other in combinations([one for one in events if one not in left_out], 2):
            if one[:2] != other[:2] and not (alike and _is_mirrored((one, other))):
                yield one, other


@cache
def _is_mirrored(events: tuple[Event, ...]) -> bool:
    """True if the same with the axes exchanged is tried as well, where both are alike."""
    mirrored = []
    for event in events:
        other = event._replace(axis=(SLIDE, HIP)[event.axis]) if event.axis >= 0 else event
        alone = event.kind is Kind.REQUEST and event.what[1].axis
        if other not in ORDER or alone:
            return False
        mirrored.append(other)
    return sorted(ORDER[one] for one in mirrored) < sorted(ORDER[one] for one in events)


def way(state: State, events: tuple[Event, ...]) -> str:
    """How a state was reached from power-on, and what came then: one line for each cycle."""
    lines = [_line(state.mode, events)]
    while state.parent is not None:
        lines.append(_line(state.parent.mode, state.events))
        state = state.parent
    return "\n".join(reversed(lines))


def _line(mode: Mode, events: tuple[Event, ...]) -> str:
    return f"  {mode}: {' and '.join(str(one) for one in events) or 'nothing'}"
