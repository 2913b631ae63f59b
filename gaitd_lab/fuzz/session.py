"""One session from its seed: the real loop on the virtual machine, with random events.

All random values come from the seed: events and their times, lost frames, the noise of the plant. A
seed therefore reproduces a session bit for bit.
"""

import random
from collections import deque
from functools import partial
from typing import Final

import msgspec
import numpy as np

from daemon.config.bundle import Settings
from daemon.config.drive_plan import drive_limits, effort_per_motor_nm
from daemon.config.robot import leg_parameters
from daemon.core.modes.persistent_state import PersistentState
from daemon.core.modes.table import IllegalTransitionError
from daemon.ipc.record import CycleRecord, Mode, Outcome, StopCategory
from drives.cia402.torque import count_nm
from drives.cia402.units import expected_base
from drives.errors import BringUpRefused
from gaitd_lab.fuzz.assisted import AssistBounds, AssistWatch
from gaitd_lab.fuzz.controller import RandomController
from gaitd_lab.fuzz.event_generator import Action, EventGenerator, Kind
from gaitd_lab.fuzz.invariants import Watch
from gaitd_lab.fuzz.lossy_world import LossyWorld
from gaitd_lab.fuzz.restartable_gateway import RestartableGateway
from gaitd_lab.fuzz.stops import OBEY_CYCLES, STEPS, StopWatch
from gaitd_lab.fuzz.tally import Broken, Tally
from gaitd_lab.fuzz.watched_drive import AxisRules, WatchedDrive
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.virtual_machine import virtual_machine
from observer.mechanism.mechanism import gravity
from observer.mechanism.parameters import LegParameters
from sim_drives.build import Machine
from sim_drives.plant.truth import Pair

NS_PER_S: Final = 1_000_000_000
PERIOD_NS: Final = 10_000_000
MS: Final = 1_000_000
TRACE_LINES: Final = 400
"""Records kept for a violation: some four seconds of cycles."""
OUR_BUGS: Final = (
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
GATEWAY_SURVIVES_RATIO: Final = 0.6
"""Share of a core's deaths that its gateway survives."""
ENDING_S: Final = 8.0
"""Time limit of a normal end."""


class RandomSession:
    """A machine, a service, and random events."""

    def __init__(self, settings: Settings, seed: int, variant: str, duration_s: float) -> None:
        self._settings = settings
        self._seed = seed
        self._variant = variant
        self._duration_s = duration_s
        rng = random.Random(f"{seed}/happens")
        self._machine: Machine = virtual_machine(settings.file, seed=seed)
        self._watch = _watch(settings, self._machine)
        self._tap = LossyWorld(
            self._machine.world, random.Random(f"{seed}/thief"), self._watch.sent
        )
        self._events = _chances(settings, self._machine, rng)
        self._controller_dice = random.Random(f"{seed}/controller")
        self._controller: RandomController | None = None
        """The newest controller that has held the lease."""
        self._survival_dice = random.Random(f"{seed}/survival")
        self._gateway = RestartableGateway(self._watch.gateway_state_sent)
        self._core_count = 0
        self._session = self._start(PersistentState())
        self._dead_until_ns: int | None = None
        self._ending_until_ns: int | None = None
        self._silent_until_ns = 0
        self._loss_until_ns = 0
        self._next_ns = NS_PER_S
        self._last_cause = ""
        self._trace: deque[str] = deque(maxlen=TRACE_LINES)
        self.tally = Tally(session_count=1)

    def run(self) -> Tally:
        """Run the whole session, or up to the first violation."""
        end_ns = round(self._duration_s * NS_PER_S)
        while self._tap.now_ns < end_ns and not self._watch.violations:
            self._next_event()
            self._turn()
            self._check_state()
        return self._finish()

    # --- one turn -------------------------------------------------------------------------------

    def _turn(self) -> None:
        now_ns = self._tap.now_ns
        if self._dead_until_ns is not None:
            self._tap.world.advance_to(now_ns + PERIOD_NS)
            if self._tap.now_ns >= self._dead_until_ns:
                self._dead_until_ns = None
                self._session = self._start(self._session.state_file.persistent)
            return
        ending = self._ending_until_ns is not None
        try:
            self._session.loop.turn(shutdown=ending)
            if ending and (self._session.loop.may_end() or now_ns > (self._ending_until_ns or 0)):
                self._session.loop.leave()
                self._core_ended(0.5)
        except BringUpRefused as refused:
            self._add_to_trace(f"refused: {refused}")
            self.tally.events["core ended: drives refused"] += 1
            self._core_ended(2.0)
        except OUR_BUGS as bug:
            self._watch.breaks("our own bug", f"{type(bug).__name__}: {bug}")

    def _check_state(self) -> None:
        """Check drives, plant and the newest records in their present state."""
        self._watch.check_truth(
            self._tap.now_ns,
            {name: trainer.truth() for name, trainer in self._machine.trainers.items()},
        )
        if self._dead_until_ns is None:
            self._check_records()
        self._session.bus.sent.clear()

    def _check_records(self) -> None:
        gateway = self._gateway
        for record in gateway.fresh():
            self._watch.receive(record)
            self._count(record)
        if gateway.number and not gateway.silent:
            self._watch.waits(PERIOD_NS / NS_PER_S, gateway.number)

    def _count(self, record: CycleRecord) -> None:
        tally, verdict = self.tally, record.verdict
        tally.cycle_count += 1
        tally.modes[record.mode.name.lower()] += 1
        cause = verdict.cause.name.lower() if verdict.category > StopCategory.NONE else ""
        if cause and cause != self._last_cause:
            tally.stops[f"{verdict.category.name} {cause}"] += 1
        self._last_cause = cause
        self._trace.append(_line(self._tap.now_ns, record))
        for event in record.events:
            self._trace.append(f"{self._tap.now_ns / NS_PER_S:10.3f}  event: {event}")
        msgspec.msgpack.encode(record)  # a record that cannot be encoded reaches no client

    # --- events ---------------------------------------------------------------------------------

    def _next_event(self) -> None:
        now_ns = self._tap.now_ns
        self._gateway.silent = now_ns < self._silent_until_ns
        self._end_stale_lease(now_ns)
        if now_ns >= self._loss_until_ns:
            self._tap.loss_ratio = 0.0
        if now_ns < self._next_ns or self._dead_until_ns is not None:
            return
        self._next_ns = now_ns + round(self._events.pause_s() * NS_PER_S)
        records = self._gateway.records
        mode = records[-1].mode if records else Mode.OFF
        action = self._events.next(mode, lease_held=self._gateway.lease != 0)
        self._add_to_trace(str(action))
        self._do(action)

    def _do(self, action: Action) -> None:
        now_ns, tally = self._tap.now_ns, self.tally
        until_ns = now_ns + round(action.duration_s * NS_PER_S)
        if action.kind is not Kind.REQUEST:
            tally.events[action.kind.value] += 1
        match action.kind:
            case Kind.REQUEST:
                self._request(action)
            case Kind.STOP:
                self._stop()
            case Kind.STOP_AND_REQUEST:
                self._request(action)
                self._stop()
            case Kind.FAULT:
                self._break_something(action)
            case Kind.PATIENT:
                self._machine.command(f"patient {action.programme}")
            case Kind.FRAMES_LOST:
                self._tap.loss_ratio, self._loss_until_ns = action.loss_ratio, until_ns
            case Kind.LOOP_LATE:
                self._session.bus.let_pass(until_ns)
            case Kind.GATEWAY_SILENT:
                self._silent_until_ns = until_ns
            case Kind.GATEWAY_RESTART:
                self._silent_until_ns = until_ns
                self._gateway.restart()
            case Kind.LEASE:
                self._grant_lease()
            case Kind.LEASE_ENDED:
                self._gateway.end_lease()
            case Kind.CONTROLLER_DEAD:
                if self._controller is not None:
                    self._controller.dead_since_ns = now_ns
            case Kind.CORE_KILLED:
                self._core_ended(action.duration_s)
            case Kind.CORE_ENDED:
                self._ending_until_ns = now_ns + round(ENDING_S * NS_PER_S)
            case Kind.NOTHING:
                return

    def _request(self, action: Action) -> None:
        """Send one request at a time, like the gateway."""
        gateway = self._gateway
        outstanding = gateway.number and self._watch.outcome(gateway.number) == Outcome.PENDING
        if outstanding or gateway.silent or not gateway.records:
            return
        gateway.request(action.request, action.wanted)
        self._watch.request_sent(gateway.number, action.request, action.wanted)

    def _grant_lease(self) -> None:
        """Give the lease to one holder at a time."""
        gateway = self._gateway
        if gateway.lease or gateway.silent:
            return
        limits = self._settings.limits
        most_si = limits.hip.assist_max_nm, limits.slide.assist_max_n
        legs = [leg.name for leg in self._settings.legs]
        self._controller = RandomController(
            self._controller_dice, legs, most_si, self.tally.setpoints
        )
        self._controller.lease = gateway.grant_lease(self._controller)

    def _end_stale_lease(self, now_ns: int) -> None:
        """End an expired lease like the gateway: repeated setpoints do not renew it."""
        controller, gateway = self._controller, self._gateway
        if controller is None or controller.dead_since_ns is None or gateway.silent:
            return
        expired = now_ns - controller.dead_since_ns > self._settings.trainer.lease.duration_ms * MS
        if expired and gateway.lease == controller.lease:
            gateway.end_lease()

    def _stop(self) -> None:
        self._gateway.stop()
        if not self._gateway.silent:
            self._watch.requests_stop()

    def _break_something(self, action: Action) -> None:
        order = action.fault
        if order is None:
            return
        self._machine.world.inject(order)
        self.tally.faults[order.kind.value] += 1
        until_ns = self._tap.now_ns + round((order.duration_s or 0.0) * NS_PER_S)
        self._watch.injects(order.kind, order.drive, until_ns)

    def _core_ended(self, for_s: float) -> None:
        """The core's process has ended."""
        self._dead_until_ns = self._tap.now_ns + round(for_s * NS_PER_S)
        self._ending_until_ns = None
        self._watch.core_ended()

    def _start(self, persistent: PersistentState) -> LockstepSession:
        """Start a core; the gateway of the previous one continues, or is restarted as well."""
        self._core_count += 1
        boot_id = f"core {self._core_count}"
        if self._survival_dice.random() > GATEWAY_SURVIVES_RATIO:
            self._gateway = RestartableGateway(self._watch.gateway_state_sent)
        self._gateway.expect(boot_id)
        self._controller = None
        return LockstepSession(
            self._settings,
            self._machine,
            world=self._tap,
            persistent=persistent,
            gateway=self._gateway,
            boot_id=boot_id,
        )

    # --- the end ----------------------------------------------------------------------------------

    def _add_to_trace(self, text: str) -> None:
        self._trace.append(f"{self._tap.now_ns / NS_PER_S:10.3f}  -- {text}")

    def _finish(self) -> Tally:
        tally = self.tally
        tally.simulated_s = self._tap.now_ns / NS_PER_S
        tally.stolen_count = self._tap.stolen_count
        tally.checked = self._watch.checked + self._watch.assist.checked
        tally.requests = self._watch.answered
        tally.broken = [
            Broken(violation, self._seed, self._variant, self._duration_s, tuple(self._trace))
            for violation in self._watch.violations
        ]
        return tally


def _line(now_ns: int, record: CycleRecord) -> str:
    """Format one cycle of the trace."""
    drives = " | ".join(
        f"{drive.power_state} {_number(drive.position_si)} {_number(drive.velocity_si)} "
        f"{_number(drive.effort_si)}"
        for drive in record.drives
    )
    verdict = record.verdict
    return (
        f"{now_ns / NS_PER_S:10.3f}  {record.cycle} {record.mode.name.lower()} "
        f"{verdict.category.name} {verdict.cause.name.lower()} {verdict.drive} | {drives}"
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _chances(settings: Settings, machine: Machine, rng: random.Random) -> EventGenerator:
    programmes = {name for trainer in machine.trainers.values() for name in trainer.programmes}
    return EventGenerator(
        rng,
        machine.world.drives,
        sorted(programmes),
        sorted(settings.trainer.excite),
        settings.trainer.gait.cadence_max_hz,
    )


def _watch(settings: Settings, machine: Machine) -> Watch:
    cycle = settings.trainer.cycle
    escalation_s = STEPS * OBEY_CYCLES * cycle.period_ms * 1e-3
    detection_s = cycle.drive_detection_ms * 1e-3
    rules = [rule for number in range(len(settings.legs)) for rule in _rules(settings, number)]
    return Watch(
        drives={rule.node_id: WatchedDrive(rule, machine.world.node(rule.name)) for rule in rules},
        period_s=cycle.period_ms * 1e-3,
        detection_s=detection_s,
        load_of=partial(_load, leg_parameters(settings.robot)),
        assist=AssistWatch(_assist_bounds(settings)),
        stops=StopWatch(escalation_s + detection_s),
    )


def _load(leg: LegParameters, position: Pair) -> Pair:
    """Return the effort that holds the leg still: N·m, N."""
    hip_nm, slide_n = gravity(leg, np.array(position))
    return float(hip_nm), float(slide_n)


def _assist_bounds(settings: Settings) -> AssistBounds:
    limits = settings.limits
    return AssistBounds(
        most_si=(limits.hip.assist_max_nm, limits.slide.assist_max_n),
        age_max_cycles=limits.assist.setpoint_age_max_cycles,
        fade_cycles=limits.stop.assist_fade_ms // settings.trainer.cycle.period_ms,
        first_cycles=limits.assist.first_setpoint_cycles,
    )


def _rules(settings: Settings, number: int) -> tuple[AxisRules, AxisRules]:
    limits, leg = settings.limits, settings.legs[number]
    rates = limits.hip.torque_rate_max_nm_per_s, limits.slide.force_rate_max_n_per_s
    hip, slide = (
        AxisRules(
            name=drive.name,
            node_id=drive.node_id,
            axis=axis,
            leg=leg.name,
            low_si=written.position_min_si,
            high_si=written.position_max_si,
            effort_per_count_si=count_nm(drive.profile.target_torque, expected_base(drive))
            * effort_per_motor_nm(drive),
            rate_si_per_s=rates[axis],
        )
        for axis, (drive, written) in enumerate(
            zip((leg.hip, leg.slide), drive_limits(limits), strict=True)
        )
    )
    return hip, slide
