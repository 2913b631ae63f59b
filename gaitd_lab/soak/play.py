"""A soak over time: faults, the operator's requests, and the collected results."""

import json
import os
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from daemon import wire
from gaitd.remote import Target, open_client
from gaitd_lab.requests import Requests
from gaitd_lab.soak import memory
from gaitd_lab.soak.happenings import DEATHS_RATIO, Actor, Chances, Happening
from gaitd_lab.soak.machinery import PARTS, Machinery, RecordTail
from gaitd_lab.soak.operator import Operator, Situation
from gaitd_lab.soak.witness import Tally, Witness
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
    happenings: list[tuple[float, Happening]]
    recovery_s: list[float]
    """Times from the begin of each fault that caused a stop until the leg walked again."""
    memory: dict[str, list[memory.Sample]]
    wall_clock: bool
    """True if time was the computer's."""
    wall_s: float
    """Duration of the soak in the computer's time."""
    cpu_s: float
    """Processor time of the three processes."""
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


class StuckError(Exception):
    """The machine does not walk any more; the message contains its mode."""


class Soak:
    """One soak with one set of processes."""

    def __init__(
        self, made: Machinery, seed: int, duration_s: float, say: Callable[[float, str], None]
    ) -> None:
        """Prepare.

        Args:
            made: the processes, started.
            seed: seed of all random values.
            duration_s: duration from the first stride on, in the machinery's time.
            say: receives the time and the events, several times a second.
        """
        self._made, self._seed, self._duration_s, self._say = made, seed, duration_s, say
        self._chances = Chances(seed, made.drives)
        self._operator = Operator(self._chances.walk)
        self._requests = Requests(made.target, "gaitd soak")
        self._tail = RecordTail(made.ring_path)
        self._witness = Witness()
        self._memory: dict[str, list[memory.Sample]] = {part: [] for part in PARTS}
        self._time = made.time
        self._begun_s = self._walked_s = 0.0
        self._has_walked = False
        self._sampled_s = 0.0
        self._happening: Happening | None = None
        self._happened_s = 0.0
        self._healed, self._healed_s = True, 0.0
        self._stopped_s: float | None = None
        self._next_s = 0.0
        self._stops_before = 0
        self._log: list[tuple[float, Happening]] = []
        self._recovery_s: list[float] = []
        self._flood = Flood(made.target, made.leg)
        self._realtime = False

    def run(self) -> Soaked:
        """Run until the time is over, or the machine cannot be returned to gait."""
        trouble, begun_wall_s = "", time.monotonic()
        try:
            self._time.take()
            self._begun_s = self._walked_s = self._time.now_s()
            self._until_walking()
            begun_wall_s, self._begun_s = time.monotonic(), self._time.now_s()
            end_s = self._begun_s + self._duration_s
            while self._time.now_s() < end_s or self._happening is not None:
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
        lives = [life for name in PARTS for life in memory.lives(name, self._memory[name])]
        return Soaked(
            seed=self._seed,
            duration_s=passed_s,
            asked_s=self._duration_s,
            tally=self._witness.tally,
            happenings=self._log,
            recovery_s=self._recovery_s,
            memory={name: self._since_begin(life) for name, life in self._memory.items()},
            wall_clock=self._time.is_wall_clock,
            wall_s=wall_s,
            cpu_s=sum(life.cpu_ratio * life.duration_s for life in lives),
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
        while not self._witness.walks:
            self._turn()
        self._realtime = os.sched_getscheduler(self._made.parts["core"].pid) in _REALTIME

    def _turn(self) -> None:
        happening = self._happening
        in_haste = self._has_walked and (happening is None or happening.doer not in BY_PROCESS)
        self._time.turn(self._turn_s(), in_haste=in_haste)
        now_s = self._time.now_s()
        self._witness.hear(self._tail.read(), now_s - self._begun_s, happening)
        self._made.revive()
        self._note_memory(now_s)
        self._insist_on_gait(now_s)
        self._go_on(now_s)
        self._operate(now_s)
        self._say(now_s - self._begun_s, self._words())

    def _turn_s(self) -> float:
        """Duration of a turn; it ends earlier at the begin or the end of a fault."""
        happening = self._happening
        due_s = self._happened_s + happening.duration_s if happening else self._next_s
        left_s = due_s - self._time.now_s()
        return min(left_s, TURN_S) if left_s > LEAST_TURN_S else TURN_S

    def _words(self) -> str:
        newest, tally = self._witness.newest, self._witness.tally
        mode = newest.mode.name.lower() if newest else "starting"
        now = f", {self._happening}" if self._happening else ""
        return f"{mode}{now}; {tally.cycle_count} cycles, {len(tally.stops)} stops"

    def _note_memory(self, now_s: float) -> None:
        every_s = min(MEMORY_EVERY_S, self._duration_s / MEMORY_SAMPLES_MIN)
        if now_s < self._sampled_s + every_s:
            return
        self._sampled_s = now_s
        for part in PARTS:
            found = memory.sample(self._made.parts[part].pid, now_s)
            if found is not None:
                self._memory[part].append(found)

    def _insist_on_gait(self, now_s: float) -> None:
        if self._witness.walks and not self._witness.stopped:
            self._has_walked, self._walked_s = True, now_s
        within_s = WALKING_WITHIN_S if self._has_walked else START_WITHIN_S
        if now_s > self._walked_s + within_s:
            newest = self._witness.newest
            mode = f"{newest.mode.name}, {newest.verdict}" if newest else "no record"
            raise StuckError(f"no gait for {within_s:g} s: {mode}; {self._happening}")

    # --- faults ---------------------------------------------------------------------------------

    def _go_on(self, now_s: float) -> None:
        if self._happening is None:
            if self._witness.walks and now_s >= self._next_s:
                self._begin(now_s)
            return
        if not self._healed and self._is_over(now_s):
            self._heal()
            self._stopped_s = self._stopped_s or now_s
        if self._healed and self._witness.walks and now_s >= self._healed_s + SETTLE_S:
            self._finish(self._happening, now_s)

    def _begin(self, now_s: float) -> None:
        passed_s = now_s - self._begun_s
        if not 0.0 <= passed_s < self._duration_s:
            return
        happening = self._chances.next(deaths=passed_s < DEATHS_RATIO * self._duration_s)
        self._happening, self._happened_s, self._healed = happening, now_s, False
        self._stopped_s, self._stops_before = None, len(self._witness.tally.stops)
        self._log.append((passed_s, happening))
        match happening.doer:
            case Actor.DRIVE:
                self._time.tell_drives(happening.words)
            case Actor.PATIENT:
                self._time.tell_drives(f"patient {happening.words}")
            case Actor.KILL:
                self._made.kill(happening.words)
            case Actor.HALT:
                self._halt(happening)
            case Actor.FLOOD:
                self._flood.begin(happening.duration_s)

    def _halt(self, happening: Happening) -> None:
        """Halt a process; a short halt is timed here, because a turn is longer."""
        self._made.halt(happening.words, on=True)
        if happening.duration_s < TURN_S:
            self._time.turn(happening.duration_s, in_haste=True)
            self._made.halt(happening.words, on=False)

    def _is_over(self, now_s: float) -> bool:
        """Return whether a fault is over: its time has passed, or the machine has stopped."""
        happening = self._happening
        if happening is None or now_s >= self._happened_s + happening.duration_s:
            return True
        if self._stopped_s is None and len(self._witness.tally.stops) > self._stops_before:
            self._stopped_s = now_s
        by_itself = happening.doer in {Actor.KILL, Actor.HALT, Actor.FLOOD}
        stopped_s = self._stopped_s
        return not by_itself and stopped_s is not None and now_s > stopped_s + CLEARED_AFTER_S

    def _heal(self) -> None:
        """Undo the fault."""
        self._healed, self._healed_s = True, self._time.now_s()
        happening = self._happening
        if happening is None:
            return
        match happening.doer:
            case Actor.DRIVE:
                kinds = [line.split()[0] for line in happening.words.splitlines()]
                lines = [f"clear {kind} {happening.drive}" for kind in kinds]
                self._time.tell_drives("\n".join(lines))
            case Actor.PATIENT:
                self._time.tell_drives("patient passive")
            case Actor.KILL:
                self._made.start(happening.words)
            case Actor.HALT:
                self._made.halt(happening.words, on=False)
            case Actor.FLOOD:
                self._flood.end()

    def _finish(self, happening: Happening, now_s: float) -> None:
        stopped = len(self._witness.tally.stops) > self._stops_before
        law = happening.law
        if stopped:
            self._recovery_s.append(now_s - SETTLE_S - self._happened_s)
        elif law.stops and not law.may_go_on:
            self._witness.never_stopped(now_s - self._begun_s, happening)
        self._happening = None
        self._next_s = now_s + self._chances.pause_s()

    # --- the operator -----------------------------------------------------------------------------

    def _operate(self, now_s: float) -> None:
        newest = self._witness.newest
        outcome, reason = self._requests.outcome()
        mode = newest.mode if newest else None
        referenced = newest is None or all(drive.referenced for drive in newest.drives)
        now = Situation(now_s, mode, self._healed, outcome, reason, referenced)
        asked = self._operator.next(now)
        if asked is not None:
            self._requests.ask(asked)


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
        with open_client(self._target.endpoints) as session:
            name = wire.key(self._target.trainer, self._leg, wire.SETPOINT)
            end_s = time.monotonic() + duration_s
            while time.monotonic() < end_s and not self._over.is_set():
                for _ in range(self.RATE_HZ // 100):
                    session.put(name, self.PAYLOAD, encoding=wire.encoding(wire.SetpointMessage))
                    self.sent_count += 1
                time.sleep(0.01)


_REALTIME: Final = frozenset({os.SCHED_FIFO, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK})
