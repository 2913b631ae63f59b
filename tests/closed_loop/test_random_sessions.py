"""Random sessions: the real loop on the virtual machine among events that Hypothesis draws.

An example is one session, and each of its rules an event with the time that follows it. What must
never happen is in `gaitd_lab/random_sessions/invariants.py`. A session that breaks an invariant is
shrunk to the fewest and mildest events that still break it, and printed as a program.

An operator keeps the machine walking: what has waited in fault, ready or hold for some cycles is
reset, enabled, and sent on to one of the operator's goals. Nearly all of the time would be spent in
fault otherwise.

`make test` plays the same sessions each time. `make test-all` plays about an hour of others, and
prints their seed when one fails; `pytest --hypothesis-seed=N` repeats them.
"""

import math
import random
import tempfile
from collections import deque
from pathlib import Path
from typing import ClassVar, NamedTuple

import msgspec
import pytest
from gaitd_names import Mode, Outcome, RequestKind, StopCategory
from hypothesis import HealthCheck, event, seed, settings
from hypothesis import strategies as st
from hypothesis.internal.conjecture import providers
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)
from msgspec.structs import replace
from sessions import CONFIGS

from daemon.core.modes.persistent_state import PersistentState
from daemon.core.modes.table import IllegalTransitionError
from daemon.ipc.record import AxisSetpoint, ModeRequest, Setpoint
from daemon.preflight.load import load
from drives.errors import BringUpRefused
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.random_sessions.build import build_watch
from gaitd_lab.random_sessions.lossy_world import LossyWorld
from gaitd_lab.random_sessions.restartable_gateway import RestartableGateway
from gaitd_lab.random_sessions.variants import VARIANTS, written
from gaitd_lab.virtual_machine import virtual_machine
from sim_drives.faults.script import EVERY_DRIVE, FaultOrder
from sim_drives.settings import FaultKind

NS_PER_S = 1_000_000_000
MS = 1_000_000
PERIOD_NS = 10_000_000
TRACE_LINES = 60
EVENTS = 14
"""Events of a session, which is some 15 s long."""
SEED, SESSIONS = 38, 3
"""Sessions of `make test`: the simplest one, and two with all that may happen."""
SEEN = {"GAIT", "TORQUE", "HAND_GUIDING", "SELF_TEST", "S0", "S1", "S2"}
"""Modes and stops that must be in them."""
SHRINKING_S, NIGHT_S = 900, 3600
"""Time limits of the tests: a session that breaks an invariant is played some hundred times."""
BRING_UP_CYCLES = 150
ENDING_NS = 8 * NS_PER_S
"""Time limit of a normal end."""
REFUSED_CYCLES = 200
"""Time to the next core, after one that refused the drives."""
OUR_BUGS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    IllegalTransitionError,
    LookupError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""Exceptions that a cycle must never raise."""

# --- setpoints of a controller --------------------------------------------------------------------

WRONG = {
    "stale": lambda s, most: replace(s, for_cycle=s.for_cycle - 30),
    "reordered": lambda s, most: replace(s, seq=s.seq - 5),
    "repeated": lambda s, most: replace(s, seq=s.seq - 1),
    "ahead of time": lambda s, most: replace(s, for_cycle=s.for_cycle + 1000),
    "of another lease": lambda s, most: replace(s, lease=s.lease + 7),
    "of another leg": lambda s, most: replace(s, leg="middle"),
    "not neutral in any mode": lambda s, most: replace(s, hip=AxisSetpoint(1.0)),
    "hip not a number": lambda s, most: replace(s, hip=AxisSetpoint(math.nan)),
    "slide infinite": lambda s, most: replace(s, slide=AxisSetpoint(-math.inf)),
    "stiffness not a number": lambda s, most: replace(s, stiffness_ratio=math.nan),
    "hip just out of range": lambda s, most: replace(s, hip=AxisSetpoint(-1.001 * most[0])),
    "hip far out of range": lambda s, most: replace(s, hip=AxisSetpoint(1e300)),
    "slide out of range": lambda s, most: replace(s, slide=AxisSetpoint(3.0 * most[1])),
    "stiffer than allowed": lambda s, most: replace(s, stiffness_ratio=1.5),
}
"""What may be wrong with a setpoint, and how a valid one becomes so."""
WRONG_EACH = 10
"""Every tenth setpoint is a wrong one, if any is."""
TARGET_CYCLES = 50
"""Cycles from one target to the next."""


class Plan(NamedTuple):
    """What a controller sends."""

    targets: list[tuple[float, float, float]]
    """Assist of hip and slide relative to their limits, stiffness ratio."""
    wrong: list[str]


class Controller:
    """Answers each record with a setpoint for each leg, until it dies."""

    def __init__(self, plan, legs, most_si):
        self.plan = plan
        self.lease = 0
        self.dead_since_ns = None
        """Time of its death; the gateway forwards its last setpoints until the lease is over."""
        self._legs = legs
        self._most_si = most_si
        self._seq = 0
        self._sent = ()

    def __call__(self, record):
        if self.dead_since_ns is None:
            self._seq += 1
            self._sent = tuple(self._setpoint(record, leg) for leg in self._legs)
        return self._sent

    def _setpoint(self, record, leg):
        targets, wrong = self.plan
        target = targets[self._seq // TARGET_CYCLES % len(targets)]
        hip, slide, stiffness_ratio = (
            target if record.mode in {Mode.TORQUE, Mode.GAIT} else (0.0, 0.0, 1.0)
        )
        assist = hip * self._most_si[0], slide * self._most_si[1]
        wanted = map(AxisSetpoint, assist)
        good = Setpoint(self.lease, self._seq, record.cycle, *wanted, leg, stiffness_ratio)
        number, rest = divmod(self._seq, WRONG_EACH)
        if not wrong or rest:
            return good
        return WRONG[wrong[number % len(wrong)]](good, self._most_si)


# --- what is drawn --------------------------------------------------------------------------------

CADENCE_MAX_HZ = 0.5
DRIVES = ("right/hip", "right/slide")
PROGRAMMES = ("passive", "active", "resisting", "pushes", "spasm", "tiring", "scripted")
SCENARIOS = ("delay", "friction_hip", "friction_slide", "open_loop", "paper")
OF_ALL = (
    FaultKind.LOST_TPDO,
    FaultKind.LATE_TPDO,
    FaultKind.SILENT,
    FaultKind.UNPLUGGED,
    FaultKind.DEAF,
    FaultKind.REBOOT,
    FaultKind.STO_OPEN,
    FaultKind.HAND_SWITCH_OPEN,
    FaultKind.EMCY,
)
"""Faults that may affect all drives at once: of the bus, the supply, and the safety chain."""
EMCY_CODES = (0x2310, 0x3210, 0x3220, 0x4310, 0x5441, 0x7320, 0x8120, 0x8611, 0xFF01)
VALUES = {
    FaultKind.LOST_TPDO: st.integers(0, 3),
    FaultKind.LATE_TPDO: st.floats(0.5, 25.0),
    FaultKind.TPDO_ALL_ONES: st.integers(1, 3),
    FaultKind.EMCY: st.sampled_from(EMCY_CODES),
    FaultKind.REFUSES_OBJECT: st.sampled_from((0x6065, 0x607D, 0x6085, 0x1016)),
    FaultKind.WRONG_IDENTITY: st.sampled_from((0, 0x1234)),
    FaultKind.SLOW_STATE: st.floats(1.0, 200.0),
    FaultKind.ENCODER_GLITCH: st.sampled_from((2, -2, 50, -50, 500, -500, 20_000, -20_000)),
    FaultKind.TORQUE_OFFSET: st.floats(-1500.0, 1500.0),
    FaultKind.HOME_SWITCH_STUCK: st.integers(0, 1),
}
"""Faults with a value; all others have none."""


@st.composite
def faults(draw):
    kind = draw(st.sampled_from(tuple(FaultKind)))
    drive = draw(st.sampled_from((*DRIVES, EVERY_DRIVE) if kind in OF_ALL else DRIVES))
    value = float(draw(VALUES.get(kind, st.just(0.0))))
    return FaultOrder(drive, kind, draw(st.floats(0.02, 2.5)), value)


def numbers(usual):
    odd = st.sampled_from((0.0, -1.0, math.nan, math.inf, -math.inf, 1e300, 1e-300))
    return st.one_of(*[st.floats(0.0, 1.2 * usual)] * 3, odd)


def cycles(low, high):
    """As often below a tenth of the range as above."""
    return st.integers(low, high // 10) | st.integers(low, high)


MODES = st.sampled_from(tuple(Mode))
WALKS = st.builds(
    ModeRequest,
    st.just(Mode.GAIT),
    st.floats(0.1 * CADENCE_MAX_HZ, CADENCE_MAX_HZ),
    st.floats(0.3, 1.0),
    st.floats(5.0, 60.0),
)
WANTED = st.one_of(
    WALKS,
    *[
        st.builds(
            ModeRequest,
            MODES,
            numbers(CADENCE_MAX_HZ),
            numbers(1.0),
            numbers(20.0),
            st.sampled_from((*SCENARIOS, "", "unknown")),
            st.sampled_from((*DRIVES, "", "left/knee")),
            st.booleans(),
        )
    ]
    * 2,
)
REQUESTS = st.sampled_from([kind for kind in RequestKind if kind != RequestKind.NONE])
RATIOS = st.floats(-1.0, 1.0).map(lambda ratio: ratio**3)  # mostly small
PLANS = st.builds(
    Plan,
    st.lists(st.tuples(RATIOS, RATIOS, st.just(1.0) | st.floats(0.0, 1.0)), min_size=1, max_size=4),
    st.lists(st.sampled_from(sorted(WRONG)), max_size=4),
)
GOALS = st.one_of(
    *[st.tuples(WALKS, st.none() | PLANS)] * 3,
    *[st.tuples(st.just(ModeRequest(Mode.TORQUE)), PLANS)] * 2,
    st.tuples(st.builds(ModeRequest, st.sampled_from((Mode.HAND_GUIDING, Mode.SELF_TEST)))),
)
"""A mode after hold, and what a controller with a lease sends there."""
PAUSES = cycles(2, 300)
SHORT = cycles(5, 100)


class RandomSession(RuleBasedStateMachine):
    """A machine, a service, an operator, and events; each rule lets `pause` cycles pass."""

    visited: ClassVar[set]
    """Names of the modes and of the categories of stops, of all sessions of a run."""

    @initialize(
        variant=st.sampled_from(sorted(VARIANTS)),
        noise=st.integers(0, 1000),
        goals=st.lists(GOALS, min_size=1, max_size=4),
        patience=cycles(5, 200),
        is_stopped=st.booleans(),
    )
    def power_on(self, variant, noise, goals, patience, is_stopped):
        self.folder = tempfile.TemporaryDirectory()
        self.settings = load(written(VARIANTS[variant], CONFIGS, Path(self.folder.name) / "c"))
        self.machine = virtual_machine(self.settings.file, seed=noise)
        self.watch = build_watch(self.settings, self.machine)
        self.world = LossyWorld(self.machine.world, self.watch.sent)
        self.goals, self.patience, self.is_stopped = goals, patience, is_stopped
        self.goal_count = self.waited_cycles = self.core_count = 0
        self.silent_until_ns = 0
        self.trace = deque(maxlen=TRACE_LINES)
        self.gateway = RestartableGateway(self.watch.gateway_state_sent)
        self.start_core(PersistentState())
        self.play(BRING_UP_CYCLES)

    def start_core(self, persistent):
        self.core_count += 1
        boot_id = f"core {self.core_count}"
        self.gateway.expect(boot_id)
        self.controller = self.ending_until_ns = None
        self.session = LockstepSession(
            self.settings,
            self.machine,
            world=self.world,
            persistent=persistent,
            gateway=self.gateway,
            boot_id=boot_id,
        )

    def teardown(self):
        self.folder.cleanup()

    # --- time -------------------------------------------------------------------------------------

    @property
    def now_ns(self):
        return self.world.now_ns

    @property
    def mode(self):
        records = self.gateway.records
        return records[-1].mode if records else Mode.OFF

    def play(self, cycles):
        end_ns = self.now_ns + cycles * PERIOD_NS
        while self.now_ns < end_ns:
            self.gateway.silent = self.now_ns < self.silent_until_ns
            self.end_stale_lease()
            self.operate()
            self.turn()
            self.check_records()

    def turn(self):
        ending = self.ending_until_ns is not None
        try:
            self.session.loop.turn(shutdown=ending)
            if ending and (self.session.loop.may_end() or self.now_ns > self.ending_until_ns):
                self.session.loop.leave()
                self.replace_core(50)
        except BringUpRefused as refused:
            self.trace.append(f"refused: {refused}")
            self.replace_core(REFUSED_CYCLES)
        except OUR_BUGS as bug:
            self.watch.breaks("our own bug", f"{type(bug).__name__}: {bug}")
        self.check_truth()

    def replace_core(self, dead_cycles):
        """The core's process has ended; another one starts from its state file."""
        self.watch.core_ended()
        for _ in range(dead_cycles):
            self.world.world.advance_to(self.now_ns + PERIOD_NS)
            self.check_truth()
        self.start_core(self.session.state_file.persistent)

    def check_truth(self):
        truths = {name: trainer.truth() for name, trainer in self.machine.trainers.items()}
        self.watch.check_truth(self.now_ns, truths)
        self.session.bus.sent.clear()
        self.judge()

    def check_records(self):
        for record in self.gateway.fresh():
            self.watch.receive(record)
            self.note(record)
        if self.gateway.number and not self.gateway.silent:
            self.watch.waits(PERIOD_NS / NS_PER_S, self.gateway.number)
        self.judge()

    def note(self, record):
        msgspec.msgpack.encode(record)  # a record that cannot be encoded reaches no client
        verdict = record.verdict
        stop = f"{verdict.category.name} {verdict.cause} {verdict.drive}"
        self.visited.update((record.mode.name, verdict.category.name))
        event(f"mode {record.mode}")
        if verdict.category is not StopCategory.NONE:
            event(f"stop {verdict.category.name} {verdict.cause}")
        drives = (
            f"{one.power_state} {one.position} {one.velocity} {one.effort}" for one in record.drives
        )
        mode = record.mode
        self.trace.append(f"{self.now_ns / NS_PER_S:.3f}  {mode} {stop} | {' | '.join(drives)}")
        self.trace.extend(f"  event: {one}" for one in record.events)

    def judge(self):
        if self.watch.violations:
            pytest.fail("\n".join((*self.trace, *map(str, self.watch.violations))), pytrace=False)

    # --- operator and gateway ---------------------------------------------------------------------

    def operate(self):
        """Bring the machine closer to walking once it has waited."""
        waits = self.mode in {Mode.FAULT, Mode.READY, Mode.HOLD}
        self.waited_cycles = self.waited_cycles + 1 if waits else 0
        if self.waited_cycles < self.patience or not self.may_ask():
            return
        self.waited_cycles = 0
        if self.mode == Mode.FAULT:
            self.ask(RequestKind.RESET)
        elif self.mode == Mode.READY:
            self.ask(RequestKind.ENABLE)
            if self.is_stopped:  # once, by another client in the same cycle
                self.is_stopped = False
                self.stop()
        else:
            wanted, *plans = self.goals[self.goal_count % len(self.goals)]
            self.goal_count += 1
            if plans and plans[0] is not None and not self.gateway.lease:
                self.grant_lease(plans[0])
            self.ask(RequestKind.MODE, wanted)

    def may_ask(self):
        """Like the gateway, only one request at a time is sent."""
        gateway = self.gateway
        outstanding = gateway.number and self.watch.outcome(gateway.number) == Outcome.PENDING
        return not outstanding and not gateway.silent and bool(gateway.records)

    def ask(self, kind, wanted=None):
        wanted = wanted or ModeRequest()
        self.gateway.request(kind, wanted)
        self.watch.request_sent(self.gateway.number, kind, wanted)

    def stop(self):
        self.gateway.stop()
        if not self.gateway.silent:
            self.watch.requests_stop()

    def grant_lease(self, plan):
        limits = self.settings.limits
        most_si = limits.hip.assist_max_nm, limits.slide.assist_max_n
        self.controller = Controller(plan, [leg.name for leg in self.settings.legs], most_si)
        self.controller.lease = self.gateway.grant_lease(self.controller)

    def end_stale_lease(self):
        """End an expired lease like the gateway: repeated setpoints do not renew it."""
        controller, gateway = self.controller, self.gateway
        if controller is None or controller.dead_since_ns is None or gateway.silent:
            return
        span_ns = self.now_ns - controller.dead_since_ns
        expired = span_ns > self.settings.trainer.lease.duration_ms * MS
        if expired and gateway.lease == controller.lease:
            gateway.end_lease()

    # --- events -----------------------------------------------------------------------------------

    @precondition(may_ask)
    @rule(kind=REQUESTS, wanted=WANTED, with_stop=st.booleans(), pause=PAUSES)
    def request(self, kind, wanted, with_stop, pause):
        self.ask(kind, wanted)
        if with_stop:
            self.stop()
        self.play(pause)

    @rule(pause=PAUSES)
    def request_stop(self, pause):
        self.stop()
        self.play(pause)

    @rule(fault=faults(), pause=PAUSES)
    def break_something(self, fault, pause):
        self.machine.world.inject(fault)
        until_ns = self.now_ns + round(fault.duration_s * NS_PER_S)
        self.watch.injects(fault.kind, fault.drive, until_ns)
        self.play(pause)

    @rule(programme=st.sampled_from(PROGRAMMES), pause=PAUSES)
    def move_like_a_patient(self, programme, pause):
        self.machine.command(f"patient {programme}")
        self.play(pause)

    @rule(
        ratio=st.sampled_from((0.01, 0.05, 0.3)), seed=st.integers(0, 99), span=SHORT, pause=PAUSES
    )
    def lose_frames(self, ratio, seed, span, pause):
        self.world.lose(ratio, self.now_ns + span * PERIOD_NS, seed)
        self.play(pause)

    @rule(late_ms=st.sampled_from((3, 12, 35, 90, 300, 2000)), pause=PAUSES)
    def delay_the_loop(self, late_ms, pause):
        self.session.bus.let_pass(self.now_ns + late_ms * MS)
        self.play(pause)

    @rule(span=SHORT, restarts=st.booleans(), pause=PAUSES)
    def silence_the_gateway(self, span, restarts, pause):
        self.silent_until_ns = self.now_ns + span * PERIOD_NS
        if restarts:
            self.gateway.restart()
        self.play(pause)

    @precondition(lambda self: not self.gateway.lease and not self.gateway.silent)
    @rule(plan=PLANS, pause=PAUSES)
    def acquire_the_lease(self, plan, pause):
        self.grant_lease(plan)
        self.play(pause)

    @precondition(lambda self: self.gateway.lease)
    @rule(pause=PAUSES)
    def end_the_lease(self, pause):
        self.gateway.end_lease()
        self.play(pause)

    @precondition(lambda self: self.controller and self.controller.dead_since_ns is None)
    @rule(pause=PAUSES)
    def kill_the_controller(self, pause):
        self.controller.dead_since_ns = self.now_ns
        self.play(pause)

    @rule(
        in_order=st.booleans(), dead_cycles=cycles(2, 200), gateway_too=st.booleans(), pause=PAUSES
    )
    def end_the_core(self, in_order, dead_cycles, gateway_too, pause):
        if in_order:
            self.ending_until_ns = self.now_ns + ENDING_NS
        else:
            if gateway_too:
                self.gateway = RestartableGateway(self.watch.gateway_state_sent)
            self.replace_core(dead_cycles)
        self.play(pause)


def play(machine, number, count):
    """Play `count` examples of a machine, drawn from a seed alone.

    Hypothesis also draws constants of all modules that are imported, which the tests before decide.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(providers, "_get_local_constants", providers.Constants)
        providers.CONSTANTS_CACHE.cache.clear()
        run_state_machine_as_test(
            seed(number)(machine),
            settings=settings(
                max_examples=count,
                stateful_step_count=EVENTS,
                database=None,
                report_multiple_bugs=False,
                suppress_health_check=list(HealthCheck),
            ),
        )


def played(number, count):
    """Play `count` sessions of a seed; return the names of modes and stops that they visited."""

    class Sessions(RandomSession):
        visited: ClassVar = set()

    play(Sessions, number, count)
    return Sessions.visited


def test_a_seed_draws_the_same_whatever_else_has_been_imported(tmp_path, monkeypatch):
    drawn = []

    class Draws(RuleBasedStateMachine):
        @rule(number=st.integers(), fault=faults(), plan=PLANS)
        def draw(self, number, fault, plan):
            drawn.append((number, fault, plan))

    play(Draws, 1, 5)
    first = list(map(repr, drawn))
    drawn.clear()
    (tmp_path / "constants.py").write_text("ODD = 4711, -815, 0.4711")
    monkeypatch.syspath_prepend(tmp_path)
    __import__("constants")
    play(Draws, 1, 5)

    assert list(map(repr, drawn)) == first
    assert len(set(first)) > 25


@pytest.mark.timeout(SHRINKING_S)
def test_random_events_break_no_invariant():
    assert played(SEED, SESSIONS) >= SEEN, "after a change of the machine: choose another SEED"


@pytest.mark.thorough
@pytest.mark.timeout(NIGHT_S)
@pytest.mark.parametrize("part", range(4))
def test_an_hour_of_random_events_breaks_no_invariant(part, request):
    given = request.config.getoption("--hypothesis-seed")
    number = int(given or random.SystemRandom().randrange(2**32)) + part
    print(f"pytest {__file__} -m thorough --hypothesis-seed={number}")

    visited = played(number, 80)

    assert visited >= SEEN
