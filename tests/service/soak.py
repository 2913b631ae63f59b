"""A service as processes that walks for long while faults of a seed come, and who watches it.

`Soak.run` lets time pass, begins and clears each fault, and requests what an operator would: reset,
enable, gait. `StopMonitor` reads all records. A stop is explained if the row of the active fault
names its cause; nothing that the computer did excuses one.
"""

import json
import signal
import threading
import time
from collections import Counter, deque
from dataclasses import dataclass, field

from gaitd_client import wire
from gaitd_client.connection import open_session
from gaitd_names import Cause, Mode, StopCategory
from scipy.stats import theilslopes

from daemon.core.safety.checks import OBSERVER_BAD_MAX_CYCLES
from gaitd_lab.process_memory import sample
from gaitd_lab.requests import Ask, Requests
from gaitd_lab.timed_service import PARTS, RecordTail, TimedService
from observer.filter.status import NIS_WINDOW_SAMPLES, Status
from simtime.processes import STOPPED, process_state
from tests.service.drawn_faults import DEATHS_RATIO, Actor, FaultGenerator

TURN_S = 0.1
LEAST_TURN_S = 0.001
SETTLE_S = 0.5
"""Time after the end of a fault, in which its consequences are observed."""
CLEARED_AFTER_S = 1.5
"""Time after a stop at which its cause is removed, if it has not ended by itself."""
WALKING_WITHIN_S = 120.0
START_WITHIN_S = 300.0
"""The first start compiles the observer's kernels."""
SILENCE_S = 0.35
"""Time without records after which a core is dead or halted."""
MEMORY_EVERY_S = 5.0
WARM_UP_RATIO = 0.25
"""Share of a process's life in which caches and allocators fill."""
LIFE_MIN_S = 600.0
S_PER_H = 3600.0
REST_S = 0.7
"""Delay before the next request, like an operator's."""
AGAIN_S = 1.0
"""Delay after a refusal, for example because a leg still moves."""
BY_PROCESS = frozenset({Actor.KILL, Actor.HALT, Actor.FLOOD})
"""Faults of processes: the process, or its restart, uses the computer's time."""
AXES = ("hip", "slide")
AT_REST = "S"
"""State of a process that waits, as in proc(5)."""
STATE_WITHIN_S = 5.0


class SoakedService(TimedService):
    """A service whose processes are killed, halted and started anew."""

    def __init__(self, configs, folder, tempo):
        super().__init__(configs, folder, tempo)
        self.drives = tuple(f"{leg['name']}/{axis}" for leg in self.table["leg"] for axis in AXES)
        self.endings = []
        """Unexpected ends of processes, each one line."""
        self._expected_dead = set()

    def start(self, part, *arguments, **options):
        self._expected_dead.discard(part)
        return super().start(part, *arguments, **options)

    def kill(self, part, number=signal.SIGKILL):
        self._expected_dead.add(part)
        super().kill(part, number)

    def turn(self, duration_s, *, in_haste):
        """Let time pass, as fast as it can or no faster than the computer's.

        What uses the computer's time, a restart or a halted process, must keep up.
        """
        begun_s = time.monotonic()
        self.time.command_drives(f"run {duration_s:.6f}")
        if not in_haste:
            time.sleep(max(duration_s - (time.monotonic() - begun_s), 0.0))

    def halt(self, part, *, on):
        """Stop a process, or let it go on until it waits again: no simulated time passes here."""
        process = self.parts[part]
        process.send_signal(signal.SIGSTOP if on else signal.SIGCONT)
        wanted, end_s = STOPPED if on else AT_REST, time.monotonic() + STATE_WITHIN_S
        while process_state(process.pid) != wanted and time.monotonic() < end_s:
            if process.poll() is not None:
                break
            time.sleep(0.001)

    def restart_ended(self):
        """Start what ended by itself again, as systemd would; without drives there is no time."""
        for part in PARTS[1:]:
            process = self.parts[part]
            if process.poll() is not None and part not in self._expected_dead:
                ended = f"gaitd {part} ended with {process.returncode}"
                self.endings.append(f"{ended}: {process.last_output()}")
                self.start(part)


@dataclass
class Stop:
    """One stop, from its first cause to the reset."""

    time_s: float
    causes: list
    fault: str
    is_explained: bool = True
    evidence: str = ""


class StopMonitor:
    """Reads every record, in order."""

    def __init__(self):
        self.stops = []
        self.cycle_count = 0
        self._recent = deque(maxlen=NIS_WINDOW_SAMPLES + OBSERVER_BAD_MAX_CYCLES)
        self._before = None
        self._received_s = 0.0
        self._is_silent = True

    @property
    def newest(self):
        """Newest record of the running core; None if there is none, or if it sends none."""
        return None if self._is_silent else self._before

    @property
    def is_stopped(self):
        return self._before is not None and self._before.verdict.category is not StopCategory.NONE

    @property
    def walks(self):
        record = self.newest
        return record is not None and record.mode == Mode.GAIT and record.gait_phase >= 0

    def read(self, records, time_s, fault):
        """Take records that were written during `fault`, until `time_s`."""
        self._received_s = time_s if records else self._received_s
        self._is_silent = time_s - self._received_s > SILENCE_S
        for record in records:
            if record.seq == 1:
                self._before = None
                self._recent.clear()
            self.cycle_count += record.mode not in {Mode.OFF, Mode.BRINGING_UP}
            self._recent.append(record)
            self._judge(record, time_s, fault)
            self._before = record

    def _judge(self, record, time_s, fault):
        cause = record.verdict.cause
        if record.verdict.category == StopCategory.NONE:
            return
        if not self.is_stopped:
            self.stops.append(Stop(time_s, [cause], str(fault)))
        elif self.stops and cause != self.stops[-1].causes[-1]:
            self.stops[-1].causes.append(cause)
        else:
            return
        allowed = fault.law.causes | fault.law.later | fault.law.latches if fault else ()
        if cause not in allowed and self.stops[-1].is_explained:
            self.stops[-1].is_explained = False
            if cause == Cause.OBSERVER_INVALID:
                self.stops[-1].evidence = self._observed()

    def _observed(self):
        """What the observer said of each leg before its stop."""
        words = []
        for number, newest in enumerate(self._recent[-1].legs):
            legs = [record.legs[number] for record in self._recent if record.legs]
            gated = sum(bool(leg.status & Status.GATED) for leg in legs)
            bits = "|".join(bit.name or "" for bit in Status(newest.status))
            words.append(f"{newest.name} {bits}, mean NIS {newest.mean_nis:.1f}, {gated} rejected")
        return ", ".join(words)


class Operator:
    """Returns the machine to gait by reset, enable, gait; uses no clock and no socket.

    If an axis is not referenced, it resets once more: a drive that started with an encoder error is
    then checked again.
    """

    def __init__(self, walk):
        self._walk = walk
        self._requested = None
        self._not_before_s = 0.0
        self._mode = None
        self._is_unreferenced = False
        self.outcomes = Counter()

    def next(self, now_s, mode, *, is_clear, outcome, is_referenced):
        """The next request, if any; `outcome` of the newest one, None while it is pending."""
        if self._requested is not None:
            if outcome is None:
                return None
            self.outcomes[f"{self._requested} {outcome}"] += 1
            self._is_unreferenced = outcome == "refused" and not is_referenced
            self._requested = None
            self._not_before_s = now_s + (REST_S if outcome == "done" else AGAIN_S)
        if mode != self._mode:
            self._mode, self._not_before_s = mode, now_s + REST_S
        if now_s < self._not_before_s or not is_clear:
            return None
        wanted = self._wanted(mode)
        self._requested = wanted.name if wanted else None
        return wanted

    def _wanted(self, mode):
        if mode == Mode.FAULT or (mode == Mode.READY and self._is_unreferenced):
            return Ask("reset", {})
        if mode == Mode.READY:
            return Ask("enable", {})
        return Ask("mode", self._walk()) if mode == Mode.HOLD else None


class Flood:
    """A client without a lease that sends setpoints as fast as it can, in a thread."""

    PAYLOAD = json.dumps(
        {"lease": 1, "seq": 1, "for_cycle": 1, "hip": {"assist": 20.0}, "slide": {"assist": 150.0}}
    )
    RATE_HZ = 5000

    def __init__(self, target, leg):
        self._target, self._leg = target, leg
        self._thread = None
        self._is_over = threading.Event()

    def begin(self, duration_s):
        self._is_over.clear()
        self._thread = threading.Thread(target=self._send, args=(duration_s,), daemon=True)
        self._thread.start()

    def end(self):
        self._is_over.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _send(self, duration_s):
        with open_session(self._target) as session:
            name = wire.key(self._target.trainer, self._leg, wire.SETPOINT)
            end_s = time.monotonic() + duration_s
            while time.monotonic() < end_s and not self._is_over.is_set():
                for _ in range(self.RATE_HZ // 100):
                    session.put(name, self.PAYLOAD, encoding=wire.encoding(wire.SetpointMessage))
                time.sleep(0.01)


@dataclass
class ActiveFault:
    """The fault that has begun, and how far it is."""

    drawn: object
    begun_s: float
    stops_before: int
    cleared_s: float | None = None
    stopped_s: float | None = None


@dataclass
class Soaked:
    """What a run has found."""

    monitor: StopMonitor
    outcomes: Counter
    missed: list = field(default_factory=list)
    """Faults that had to cause a stop, and did not."""
    memory: dict = field(default_factory=dict)
    """Samples of each process, by its part and process id."""
    exit_codes: dict = field(default_factory=dict)
    lost_count: int = 0
    """Records that were overwritten before they were read."""


class Soak:
    """One run with one set of processes."""

    def __init__(self, made, seed, duration_s):
        self._made, self._time, self._duration_s = made, made.time, duration_s
        self._faults = FaultGenerator(seed, made.drives)
        self._operator = Operator(self._faults.walk)
        self._requests = Requests(made.target, "soak")
        self._tail = RecordTail(made.ring_path)
        self._monitor = StopMonitor()
        self._found = Soaked(self._monitor, self._operator.outcomes)
        self._flood = Flood(made.target, made.leg)
        self._begun_s = self._walked_s = self._sampled_s = self._next_s = 0.0
        self._has_walked = False
        self._fault = None

    def run(self):
        """Run until the time is over.

        Raises:
            AssertionError: the leg does not walk any more.
        """
        try:
            self._time.hold()
            self._begun_s = self._walked_s = self._time.now_s()
            while not self._monitor.walks:
                self._turn()
            self._begun_s = self._time.now_s()
            while self._passed_s() < self._duration_s or self._fault is not None:
                self._turn()
        finally:
            self._flood.end()
            self._requests.close()
        self._made.end()
        self._found.lost_count = self._tail.lost_count
        self._found.exit_codes = {name: one.returncode for name, one in self._made.parts.items()}
        return self._found

    def _passed_s(self):
        return self._time.now_s() - self._begun_s

    def _turn(self):
        fault = self._fault and self._fault.drawn
        in_haste = self._has_walked and (fault is None or fault.actor not in BY_PROCESS)
        self._made.turn(self._turn_s(), in_haste=in_haste)
        now_s = self._time.now_s()
        self._monitor.read(self._tail.read(), now_s - self._begun_s, fault)
        self._made.restart_ended()
        self._sample_memory(now_s)
        self._check_gait(now_s)
        self._go_on_with_fault(now_s)
        self._ask(now_s)

    def _turn_s(self):
        """Duration of a turn; it ends earlier at the begin or the end of a fault."""
        fault = self._fault
        due_s = fault.begun_s + fault.drawn.duration_s if fault else self._next_s
        left_s = due_s - self._time.now_s()
        return min(left_s, TURN_S) if left_s > LEAST_TURN_S else TURN_S

    def _sample_memory(self, now_s):
        if now_s < self._sampled_s + MEMORY_EVERY_S:
            return
        self._sampled_s = now_s
        for part in PARTS:
            found = sample(self._made.parts[part].pid, now_s)
            if found is not None:
                self._found.memory.setdefault((part, found.pid), []).append(found)

    def _check_gait(self, now_s):
        if self._monitor.walks and not self._monitor.is_stopped:
            self._has_walked, self._walked_s = True, now_s
        within_s = WALKING_WITHIN_S if self._has_walked else START_WITHIN_S
        newest = self._monitor.newest
        assert now_s <= self._walked_s + within_s, (newest and newest.verdict, self._fault)

    def _go_on_with_fault(self, now_s):
        fault = self._fault
        if fault is None:
            if self._monitor.walks and self._next_s <= now_s < self._begun_s + self._duration_s:
                self._begin(now_s)
            return
        if fault.stopped_s is None and len(self._monitor.stops) > fault.stops_before:
            fault.stopped_s = now_s
        if fault.cleared_s is None and self._is_over(fault, now_s):
            self._clear(fault, now_s)
        is_settled = fault.cleared_s is not None and now_s >= fault.cleared_s + SETTLE_S
        if is_settled and self._monitor.walks:
            self._finish(fault, now_s)

    def _begin(self, now_s):
        drawn = self._faults.next(deaths=self._passed_s() < DEATHS_RATIO * self._duration_s)
        self._fault = ActiveFault(drawn, now_s, len(self._monitor.stops))
        match drawn.actor:
            case Actor.DRIVE:
                self._time.command_drives(drawn.words)
            case Actor.PATIENT:
                self._time.command_drives(f"patient {drawn.words}")
            case Actor.KILL:
                self._made.kill(drawn.words)
            case Actor.HALT:
                self._made.halt(drawn.words, on=True)
                if drawn.duration_s < TURN_S:
                    self._made.turn(drawn.duration_s, in_haste=True)
                    self._made.halt(drawn.words, on=False)
            case Actor.FLOOD:
                self._flood.begin(drawn.duration_s)

    @staticmethod
    def _is_over(fault, now_s):
        if now_s >= fault.begun_s + fault.drawn.duration_s:
            return True
        is_cleared = fault.stopped_s is not None and now_s > fault.stopped_s + CLEARED_AFTER_S
        return is_cleared and fault.drawn.actor not in BY_PROCESS

    def _clear(self, fault, now_s):
        fault.cleared_s, drawn = now_s, fault.drawn
        match drawn.actor:
            case Actor.DRIVE:
                kinds = [line.split()[0] for line in drawn.words.splitlines()]
                lines = [f"clear {kind} {drawn.drive}" for kind in kinds]
                self._time.command_drives("\n".join(lines))
            case Actor.PATIENT:
                self._time.command_drives("patient passive")
            case Actor.KILL:
                self._made.start(drawn.words)
            case Actor.HALT:
                self._made.halt(drawn.words, on=False)
            case Actor.FLOOD:
                self._flood.end()

    def _finish(self, fault, now_s):
        law = fault.drawn.law
        has_stopped = len(self._monitor.stops) > fault.stops_before
        if law.stops and not law.may_go_on and not has_stopped:
            self._found.missed.append(str(fault.drawn))
        self._fault, self._next_s = None, now_s + self._faults.pause_s()

    def _ask(self, now_s):
        newest = self._monitor.newest
        asked = self._operator.next(
            now_s,
            newest.mode if newest else None,
            is_clear=self._fault is None or self._fault.cleared_s is not None,
            outcome=self._requests.outcome()[0],
            is_referenced=newest is None or all(drive.referenced for drive in newest.drives),
        )
        if asked is not None:
            self._requests.send(asked)


def growth_mb_per_h(samples):
    """Median of the slopes between any two samples of a process's own pages (Theil and Sen).

    A steady growth, even in many small steps, shows between most samples. A single step to a level
    that is then kept, as by the first backlog of a halted process, is no growth. None: too short.
    """
    begun_s, end_s = samples[0].time_s, samples[-1].time_s
    if end_s - begun_s < LIFE_MIN_S:
        return None
    warm_s = begun_s + WARM_UP_RATIO * (end_s - begun_s)
    warm = [one for one in samples if one.time_s >= warm_s]
    return theilslopes([one.own_mb for one in warm], [one.time_s for one in warm])[0] * S_PER_H
