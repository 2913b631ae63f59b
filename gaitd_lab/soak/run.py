"""A soak over time: faults, the operator's requests, and the collected results."""

import json
import os
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gaitd_client import wire
from gaitd_client.connection import Target, open_session

from gaitd_lab.requests import Requests
from gaitd_lab.soak import memory
from gaitd_lab.soak.fault_generator import DEATHS_RATIO, ActiveFault, Actor, FaultGenerator
from gaitd_lab.soak.memory import Life, lives
from gaitd_lab.soak.operator import Operator, Situation
from gaitd_lab.soak.record_monitor import RecordMonitor, Tally
from gaitd_lab.soak.soak_processes import PARTS, RecordTail, SoakProcesses
from simtime.link import LinkLostError

TURN_S: Final = 0.1
LEAST_TURN_S: Final = 0.001
SETTLE_S: Final = 0.5
"""Time after the end of a fault, in which its consequences are observed."""
CLEARED_AFTER_S: Final = 1.5
"""Time after a stop at which its cause is removed, if it has not ended by itself."""
WALKING_WITHIN_S: Final = 120.0
"""Time limit to walk again; after it the soak ends."""
START_WITHIN_S: Final = 300.0
"""Time limit: the first start compiles the observer's kernels."""
BY_PROCESS: Final = frozenset({Actor.KILL, Actor.HALT, Actor.FLOOD})
"""Faults of processes: the process, or its restart, uses the computer's time."""
MEMORY_EVERY_S: Final = 5.0
MEMORY_SAMPLES_MIN: Final = 40
"""Least value, even in a short soak."""


@dataclass(slots=True)
class Soaked:
    """Results of a soak."""

    seed: int
    duration_s: float
    asked_s: float
    tally: Tally
    happenings: list[tuple[float, ActiveFault]]
    recovery_s: list[float]
    """Times from the begin of each fault that caused a stop until the leg walked again."""
    memory: dict[str, list[memory.Sample]]
    wall_clock: bool
    """True if time was the computer's."""
    wall_s: float
    """Duration of the soak in the computer's time."""
    outcomes: Counter[str]
    start_count: Counter[str]
    endings: list[str]
    record_lost_count: int
    """Records that this program read too late."""
    exit_codes: dict[str, int]
    realtime: bool
    """True if the core had SCHED_FIFO."""
    trouble: str = ""
    """Reason of an early end."""
    flooded_count: int = 0
    processors: int = field(default_factory=lambda: os.cpu_count() or 1)

    @property
    def lives(self) -> list[Life]:
        """Every process that lived, by part and age."""
        return [life for name, samples in self.memory.items() for life in lives(name, samples)]

    @property
    def cpu_s(self) -> float:
        """Processor time of the three processes."""
        return sum(life.cpu_ratio * life.duration_s for life in self.lives)


class StuckError(Exception):
    """The machine does not walk any more; the message contains its mode."""


class Soak:
    """One soak with one set of processes."""

    def __init__(
        self, made: SoakProcesses, seed: int, duration_s: float, say: Callable[[float, str], None]
    ) -> None:
        """Prepare.

        Args:
            made: the processes, started.
            seed: seed of all random values.
            duration_s: duration from the first stride on, in the machinery's time.
            say: receives the time and the events, several times a second.
        """
        self._made, self._seed, self._duration_s, self._say = made, seed, duration_s, say
        self._faults = FaultGenerator(seed, made.drives)
        self._operator = Operator(self._faults.walk)
        self._requests = Requests(made.target, "gaitd soak")
        self._tail = RecordTail(made.ring_path)
        self._monitor = RecordMonitor()
        self._memory: dict[str, list[memory.Sample]] = {part: [] for part in PARTS}
        self._time = made.time
        self._begun_s = self._walked_s = 0.0
        self._has_walked = False
        self._sampled_s = 0.0
        self._fault: ActiveFault | None = None
        self._fault_begin_s = 0.0
        self._is_cleared, self._cleared_s = True, 0.0
        self._stopped_s: float | None = None
        self._next_s = 0.0
        self._stops_before = 0
        self._log: list[tuple[float, ActiveFault]] = []
        self._recovery_s: list[float] = []
        self._flood = Flood(made.target, made.leg)
        self._realtime = False

    def run(self) -> Soaked:
        """Run until the time is over, or the machine cannot be returned to gait."""
        trouble, begun_wall_s = "", time.monotonic()
        try:
            self._time.hold()
            self._begun_s = self._walked_s = self._time.now_s()
            self._until_walking()
            begun_wall_s, self._begun_s = time.monotonic(), self._time.now_s()
            end_s = self._begun_s + self._duration_s
            while self._time.now_s() < end_s or self._fault is not None:
                self._turn()
        except StuckError as error:
            trouble = str(error)
        except LinkLostError as error:
            trouble = f"{error}: {self._made.parts['sim'].last_output()}"
        finally:
            self._flood.end()
            passed_s = self._time.now_s() - self._begun_s
            self._time.close()
            self._requests.close()
        wall_s = time.monotonic() - begun_wall_s
        self._made.end()
        return self._soaked(passed_s, wall_s, trouble)

    def _soaked(self, passed_s: float, wall_s: float, trouble: str) -> Soaked:
        return Soaked(
            seed=self._seed,
            duration_s=passed_s,
            asked_s=self._duration_s,
            tally=self._monitor.tally,
            happenings=self._log,
            recovery_s=self._recovery_s,
            memory={name: self._since_begin(life) for name, life in self._memory.items()},
            wall_clock=self._time.is_wall_clock,
            wall_s=wall_s,
            outcomes=self._operator.outcomes,
            start_count=self._made.start_count,
            endings=self._made.endings,
            record_lost_count=self._tail.lost_count,
            exit_codes={name: one.returncode for name, one in self._made.parts.items()},
            realtime=self._realtime,
            trouble=trouble,
            flooded_count=self._flood.sent_count,
        )

    def _since_begin(self, samples: list[memory.Sample]) -> list[memory.Sample]:
        return [one._replace(time_s=one.time_s - self._begun_s) for one in samples]

    # --- time -----------------------------------------------------------------------------------

    def _until_walking(self) -> None:
        while not self._monitor.walks:
            self._turn()
        self._realtime = os.sched_getscheduler(self._made.parts["core"].pid) in _REALTIME

    def _turn(self) -> None:
        fault = self._fault
        in_haste = self._has_walked and (fault is None or fault.actor not in BY_PROCESS)
        self._time.turn(self._turn_s(), in_haste=in_haste)
        now_s = self._time.now_s()
        self._monitor.process(self._tail.read(), now_s - self._begun_s, fault)
        self._made.restart_ended()
        self._sample_memory(now_s)
        self._check_gait(now_s)
        self._advance_fault(now_s)
        self._run_operator(now_s)
        self._say(now_s - self._begun_s, self._words())

    def _turn_s(self) -> float:
        """Duration of a turn; it ends earlier at the begin or the end of a fault."""
        fault = self._fault
        due_s = self._fault_begin_s + fault.duration_s if fault else self._next_s
        left_s = due_s - self._time.now_s()
        return min(left_s, TURN_S) if left_s > LEAST_TURN_S else TURN_S

    def _words(self) -> str:
        newest, tally = self._monitor.newest, self._monitor.tally
        mode = newest.mode.name.lower() if newest else "starting"
        now = f", {self._fault}" if self._fault else ""
        return f"{mode}{now}; {tally.cycle_count} cycles, {len(tally.stops)} stops"

    def _sample_memory(self, now_s: float) -> None:
        every_s = min(MEMORY_EVERY_S, self._duration_s / MEMORY_SAMPLES_MIN)
        if now_s < self._sampled_s + every_s:
            return
        self._sampled_s = now_s
        for part in PARTS:
            found = memory.sample(self._made.parts[part].pid, now_s)
            if found is not None:
                self._memory[part].append(found)

    def _check_gait(self, now_s: float) -> None:
        if self._monitor.walks and not self._monitor.stopped:
            self._has_walked, self._walked_s = True, now_s
        within_s = WALKING_WITHIN_S if self._has_walked else START_WITHIN_S
        if now_s > self._walked_s + within_s:
            newest = self._monitor.newest
            mode = f"{newest.mode.name}, {newest.verdict}" if newest else "no record"
            raise StuckError(f"no gait for {within_s:g} s: {mode}; {self._fault}")

    # --- faults ---------------------------------------------------------------------------------

    def _advance_fault(self, now_s: float) -> None:
        if self._fault is None:
            if self._monitor.walks and now_s >= self._next_s:
                self._begin(now_s)
            return
        if not self._is_cleared and self._is_over(now_s):
            self._clear_fault()
            self._stopped_s = self._stopped_s or now_s
        if self._is_cleared and self._monitor.walks and now_s >= self._cleared_s + SETTLE_S:
            self._finish(self._fault, now_s)

    def _begin(self, now_s: float) -> None:
        passed_s = now_s - self._begun_s
        if not 0.0 <= passed_s < self._duration_s:
            return
        fault = self._faults.next(deaths=passed_s < DEATHS_RATIO * self._duration_s)
        self._fault, self._fault_begin_s, self._is_cleared = fault, now_s, False
        self._stopped_s, self._stops_before = None, len(self._monitor.tally.stops)
        self._log.append((passed_s, fault))
        match fault.actor:
            case Actor.DRIVE:
                self._time.command_drives(fault.words)
            case Actor.PATIENT:
                self._time.command_drives(f"patient {fault.words}")
            case Actor.KILL:
                self._made.kill(fault.words)
            case Actor.HALT:
                self._halt(fault)
            case Actor.FLOOD:
                self._flood.begin(fault.duration_s)

    def _halt(self, fault: ActiveFault) -> None:
        """Halt a process; a short halt is timed here, because a turn is longer."""
        self._made.halt(fault.words, on=True)
        if fault.duration_s < TURN_S:
            self._time.turn(fault.duration_s, in_haste=True)
            self._made.halt(fault.words, on=False)

    def _is_over(self, now_s: float) -> bool:
        """Return whether a fault is over: its time has passed, or the machine has stopped."""
        fault = self._fault
        if fault is None or now_s >= self._fault_begin_s + fault.duration_s:
            return True
        if self._stopped_s is None and len(self._monitor.tally.stops) > self._stops_before:
            self._stopped_s = now_s
        stopped_s = self._stopped_s
        cleared = stopped_s is not None and now_s > stopped_s + CLEARED_AFTER_S
        return cleared and fault.actor not in BY_PROCESS

    def _clear_fault(self) -> None:
        """Undo the fault."""
        self._is_cleared, self._cleared_s = True, self._time.now_s()
        fault = self._fault
        if fault is None:
            return
        match fault.actor:
            case Actor.DRIVE:
                kinds = [line.split()[0] for line in fault.words.splitlines()]
                lines = [f"clear {kind} {fault.drive}" for kind in kinds]
                self._time.command_drives("\n".join(lines))
            case Actor.PATIENT:
                self._time.command_drives("patient passive")
            case Actor.KILL:
                self._made.start(fault.words)
            case Actor.HALT:
                self._made.halt(fault.words, on=False)
            case Actor.FLOOD:
                self._flood.end()

    def _finish(self, fault: ActiveFault, now_s: float) -> None:
        stopped = len(self._monitor.tally.stops) > self._stops_before
        law = fault.law
        if stopped:
            self._recovery_s.append(now_s - SETTLE_S - self._fault_begin_s)
        elif law.stops and not law.may_go_on:
            self._monitor.never_stopped(now_s - self._begun_s, fault)
        self._fault = None
        self._next_s = now_s + self._faults.pause_s()

    # --- the operator -----------------------------------------------------------------------------

    def _run_operator(self, now_s: float) -> None:
        newest = self._monitor.newest
        outcome, reason = self._requests.outcome()
        mode = newest.mode if newest else None
        referenced = newest is None or all(drive.referenced for drive in newest.drives)
        now = Situation(now_s, mode, self._is_cleared, outcome, reason, referenced)
        asked = self._operator.next(now)
        if asked is not None:
            self._requests.send(asked)


class Flood:
    """A client without a lease that sends setpoints as fast as it can, in a thread."""

    PAYLOAD: Final = json.dumps(
        {"lease": 1, "seq": 1, "for_cycle": 1, "hip_assist_nm": 20.0, "slide_assist_n": 150.0}
    )
    RATE_HZ: Final = 5000

    def __init__(self, target: Target, leg: str) -> None:
        """Set the target of the setpoints."""
        self._target, self._leg = target, leg
        self._thread: threading.Thread | None = None
        self._over = threading.Event()
        self.sent_count = 0

    def begin(self, duration_s: float) -> None:
        """Start, for at most this time."""
        self._over.clear()
        self._thread = threading.Thread(target=self._send, args=(duration_s,), daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Stop, if it has not ended."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _send(self, duration_s: float) -> None:
        with open_session(self._target) as session:
            name = wire.key(self._target.trainer, self._leg, wire.SETPOINT)
            end_s = time.monotonic() + duration_s
            while time.monotonic() < end_s and not self._over.is_set():
                for _ in range(self.RATE_HZ // 100):
                    session.put(name, self.PAYLOAD, encoding=wire.encoding(wire.SetpointMessage))
                    self.sent_count += 1
                time.sleep(0.01)


_REALTIME: Final = frozenset({os.SCHED_FIFO, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK})
