"""Data of the demonstration: Zenoh messages as any client receives them, and the plant's truth.

The truth comes from the file that the virtual drives write for comparison; the service has no
access to it. Both are on the monotonic clock of the core, where the SYNC of a cycle is one instant.
"""

import math
import threading
from collections import deque
from io import TextIOWrapper
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol, Self, TypeVar

import numpy as np
from gaitd_client import NoServiceError, NotValid, Target, Trainer, wire
from numpy.typing import NDArray

from gaitd_lab.demonstration.script import Situation
from sim_drives.plant.truth import TruthRow

RECEIVED: Final = (
    *("hip_patient_nm", "slide_patient_n", "hip_patient_nm_std", "slide_patient_n_std"),
    *("hip_friction_nm", "slide_friction_n", "hip_angle_rad", "slide_position_m"),
    *("artificial_hip_nm", "artificial_slide_n"),
)
"""Stored fields of an estimate; NaN where the message has null."""
TRUE: Final = ("hip_patient_nm", "slide_patient_n", "hip_friction_nm", "slide_friction_n")
"""Stored columns of the truth."""
EVENTS_KEPT: Final = 100
CATCH_UP_S: Final = 1.0
"""Waiting time, by the computer's clock, for messages that are due."""
FRESH_NS: Final = 500_000_000
CYCLE_DONE_NS: Final = 20_000_000
"""Largest time from a SYNC to the record of its cycle."""
ESTIMATES_KEPT: Final = 16
WAITING_MAX: Final = 1000
"""All messages are stored, also when time is fast or the computer stalls."""

Values = NDArray[np.float64]
T = TypeVar("T")


class Track:
    """Values over monotonic time, written by one thread and read by another."""

    def __init__(self, columns: tuple[str, ...]) -> None:
        """Start empty."""
        self.columns = columns
        self._rows: list[tuple[int, tuple[float, ...]]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, time_ns: int, values: tuple[float, ...]) -> None:
        """Append one row; time rises."""
        self._rows.append((time_ns, values))

    def arrays(self, newest: int = 0) -> tuple[NDArray[np.int64], Values]:
        """Times, shape (n,), and values, shape (n, columns); of the newest rows, or of all."""
        rows = self._rows[-newest:]
        times = np.array([row[0] for row in rows], dtype=np.int64)
        values = np.array([row[1] for row in rows], dtype=np.float64)
        return times, values.reshape(len(rows), len(self.columns))

    def column(self, name: str, values: Values) -> Values:
        """Return one column of the result of `arrays`."""
        return values[:, self.columns.index(name)]


class ActClock(Protocol):
    """The time of an act, for the evaluation of its messages."""

    def now_ns(self) -> int:
        """Monotonic time of the core."""
        ...

    def of_utc_ns(self, utc_ns: int) -> int:
        """Return the monotonic time of an instant of the core's UTC."""
        ...


class Receiver:
    """A client like any other: subscribes, and stores the received messages."""

    def __init__(self, target: Target, leg: str, received: Track, clock: ActClock) -> None:
        """Configure the client; `connect` opens the session.

        Args:
            target: address of the service.
            leg: leg whose estimate is stored.
            received: receives the columns of RECEIVED.
            clock: clock of the act.
        """
        self._clock = clock
        self.safety: wire.Safety | None = None
        self.health: wire.Health | None = None
        self.events: deque[wire.Event] = deque(maxlen=EVENTS_KEPT)
        self.strides: list[wire.Stride] = []
        self.helps: list[wire.ControllerState] = []
        """State of the controller, if there is one, each stride."""
        self._estimates: deque[tuple[int, wire.Estimate]] = deque(maxlen=ESTIMATES_KEPT)
        """The newest messages, each with the monotonic time of its SYNC."""
        self._has_come = threading.Condition()
        self._received_s: float | None = None
        self._track = received
        self._trainer, self._leg = Trainer.of(target), leg
        self.is_connected = False
        """True if the service has accepted the connection."""

    def connect(self) -> bool:
        """Try to connect once; False if the service does not listen."""
        if self.is_connected:
            return True
        try:
            self._trainer.__enter__()
        except NoServiceError:
            return False
        self.is_connected = True
        self._trainer.estimate(self._leg, keep=WAITING_MAX).call(self._on_estimate)
        self._trainer.safety(keep=WAITING_MAX).call(self._on_safety)
        self._trainer.health().call(self._on_health)
        self._trainer.stride(self._leg).call(lambda one: _keep(one, self.strides))
        self._trainer.controller(self._leg).call(lambda one: _keep(one, self.helps))
        self._trainer.events(history_count=0).call(self._on_event)
        return True

    def catch_up(self, now_ns: int) -> None:
        """Wait for the estimates of all cycles before `now_ns`, as long as they still arrive."""
        complete_ns = now_ns - CYCLE_DONE_NS
        with self._has_come:
            if self._estimates and now_ns - self._estimates[-1][0] < FRESH_NS:
                self._has_come.wait_for(lambda: self._estimates[-1][0] >= complete_ns, CATCH_UP_S)

    def situation(self, now_ns: int, began_ns: int, outcome: str | None, reason: str) -> Situation:
        """Return the input of the script at this moment.

        Args:
            now_ns: monotonic time.
            began_ns: begin of the act.
            outcome: outcome of the last request.
            reason: reason of its refusal.
        """
        safety = self.safety
        estimate = self._estimate_at(now_ns - CYCLE_DONE_NS)
        return Situation(
            now_s=(now_ns - began_ns) * 1e-9,
            received_s=None if self._received_s is None else self._received_s - began_ns * 1e-9,
            mode=safety.mode if safety else None,
            verdict=verdict_text(safety),
            phase_ratio=estimate.gait_phase_ratio if estimate else None,
            artificial=bool(estimate and "artificial" in estimate.status),
            lease_holder=safety.lease_holder if safety else None,
            outcome=outcome,
            reason=reason,
        )

    def _estimate_at(self, time_ns: int) -> wire.Estimate | None:
        """Newest estimate of a SYNC up to a time, the same on each run; None if it is old."""
        with self._has_come:
            known = [one for one in self._estimates if one[0] <= time_ns]
        return known[-1][1] if known and time_ns - known[-1][0] < FRESH_NS else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        # A connection that is not closed keeps the process from ending.
        if self.is_connected:
            self._trainer.__exit__(kind, error, traceback)
            self.is_connected = False

    def _on_estimate(self, message: wire.Estimate | NotValid) -> None:
        if isinstance(message, NotValid):
            return
        values = tuple(
            math.nan if (value := getattr(message, name)) is None else value for name in RECEIVED
        )
        sync_ns = self._clock.of_utc_ns(message.sample_time_ns)
        self._track.add(sync_ns, values)
        self._received_s = self._clock.now_ns() * 1e-9
        with self._has_come:
            self._estimates.append((sync_ns, message))
            self._has_come.notify_all()

    def _on_safety(self, message: wire.Safety | NotValid) -> None:
        if isinstance(message, NotValid):
            return
        self.safety = message
        if message.valid:
            self._received_s = self._clock.now_ns() * 1e-9

    def _on_health(self, message: wire.Health | NotValid) -> None:
        if not isinstance(message, NotValid):
            self.health = message

    def _on_event(self, message: wire.Event | NotValid) -> None:
        if not isinstance(message, NotValid):
            self.events.append(message)


def _keep(message: T | NotValid, kept: list[T]) -> None:
    if not isinstance(message, NotValid):
        kept.append(message)


def verdict_text(safety: wire.Safety | None) -> str:
    """The latched verdict in one line; empty if there is none."""
    verdict = safety.verdict if safety else None
    if verdict is None or verdict.cause == "none":
        return ""
    where = f" at {verdict.drive}" if verdict.drive else ""
    detail = f": {verdict.detail}" if verdict.detail else ""
    return f"{verdict.category} {verdict.text}{where}{detail}"


class TruthTail:
    """Reads the truth file as it grows; whole lines only."""

    def __init__(self, path: Path, track: Track) -> None:
        """Read `path`, which need not exist yet, into the columns of TRUE."""
        self._path = path
        self._track = track
        self._file: TextIOWrapper | None = None
        self._rest = ""
        self._time = TruthRow._fields.index("sync_mono_ns")
        self._values = [TruthRow._fields.index(name) for name in TRUE]

    def read(self) -> None:
        """Read the lines written since the last call."""
        if self._file is None:
            if not self._path.exists():
                return
            self._file = self._path.open(encoding="utf-8")
        *lines, self._rest = (self._rest + self._file.read()).split("\n")
        for line in lines:
            cells = line.split(",")
            if cells[self._time].isdigit():  # else it is the header
                values = tuple(float(cells[index]) for index in self._values)
                self._track.add(int(cells[self._time]), values)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None
