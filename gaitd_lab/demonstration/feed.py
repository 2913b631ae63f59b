"""Data of the demonstration: Zenoh messages as any client receives them, and the plant's truth.

The truth comes from the file that the virtual drives write for comparison; the service has no
access to it. Both are on the monotonic clock of the core, where the SYNC of a cycle is one instant.
"""

import math
from collections.abc import Mapping
from io import TextIOWrapper
from operator import attrgetter
from pathlib import Path
from typing import Final, NamedTuple, Protocol, Self, TypeVar

import msgspec
import numpy as np
from gaitd_client import NotValid, Stream, Target, Trainer, wire
from gaitd_texts import Reader, catalogue
from numpy.typing import NDArray

from gaitd_lab.demonstration.script import Situation
from gaitd_lab.demonstration.turns import CYCLE_DONE_NS
from sim_drives.plant.truth import TruthRow

MEASURED: Final = {
    "hip_patient_nm": "hip.patient",
    "slide_patient_n": "slide.patient",
    "hip_patient_nm_std": "hip.patient_std",
    "slide_patient_n_std": "slide.patient_std",
    "hip_friction_nm": "hip.friction",
    "slide_friction_n": "slide.friction",
    "artificial_hip_nm": "hip.artificial",
    "artificial_slide_n": "slide.artificial",
    "gait_phase_ratio": "gait_phase_ratio",
}
"""Fields of an estimate by the column that stores them; NaN where the message has null."""
MEASURED_OF: Final = attrgetter(*MEASURED.values())
RECEIVED: Final = (*MEASURED, "is_artificial")
TRUE: Final = ("hip_patient_nm", "slide_patient_n", "hip_friction_nm", "slide_friction_n")
"""Columns of the truth."""
FRESH_NS: Final = 500_000_000
WAITING_MAX: Final = 1000
"""All messages are stored, also when time is fast or the computer stalls."""

Values = NDArray[np.float64]
TEXTS: Final = catalogue(Reader.OPERATOR, "en")
T = TypeVar("T", bound=msgspec.Struct)


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

    def at(self, time_ns: int) -> dict[str, float]:
        """Return the newest row up to a time, the same on each run; empty if it is of the past."""
        for row_ns, values in reversed(self._rows):
            if row_ns <= time_ns:
                is_fresh = time_ns - row_ns < FRESH_NS
                return dict(zip(self.columns, values, strict=True)) if is_fresh else {}
        return {}


class LegTracks(NamedTuple):
    """What is known of a leg."""

    received: Track
    """Columns RECEIVED."""
    true: Track
    """Columns TRUE."""

    @classmethod
    def new(cls) -> Self:
        """Return empty tracks."""
        return cls(Track(RECEIVED), Track(TRUE))


class ActClock(Protocol):
    """The time of an act, for the evaluation of its messages."""

    def now_ns(self) -> int:
        """Monotonic time of the core."""
        ...

    def utc_ahead_ns(self) -> int:
        """UTC of the core less its monotonic time."""
        ...


class Receiver:
    """A client like any other: subscribes, and stores the received messages."""

    def __init__(self, target: Target, received: Mapping[str, Track], clock: ActClock) -> None:
        """Subscribe; `with receiver.trainer` connects as soon as the service is there.

        Args:
            target: address of the service.
            received: receives the columns of RECEIVED of each leg.
            clock: clock of the act.
        """
        self._clock, self._tracks = clock, received
        self._received_ns: int | None = None
        self._newest_ns: dict[str, int] = {}
        self.safety: wire.Safety | None = None
        self.health: wire.Health | None = None
        self.events: list[wire.Event] = []
        self.strides: list[wire.Stride] = []
        """Those of the first leg."""
        self.helps: list[wire.ControllerState] = []
        """State of the controller, if there is one, each stride."""
        endpoints, credentials = target.endpoints, target.credentials
        self.trainer = Trainer(
            endpoints, credentials, trainer=target.trainer, clock=clock, keep_trying=True
        )
        self._safeties, self._healths = self.trainer.safety(), self.trainer.health()
        for leg in received:
            self.trainer.estimate(leg, keep=WAITING_MAX).call(self._on_estimate)
        first = next(iter(received))
        _keep(self.trainer.stride(first), self.strides)
        _keep(self.trainer.controller(first), self.helps)
        _keep(self.trainer.events(history_count=0), self.events)

    def situation(self, now_ns: int, began_ns: int, outcome: str | None, reason: str) -> Situation:
        """Return the state of the service at this moment.

        Args:
            now_ns: monotonic time.
            began_ns: begin of the act.
            outcome: outcome of the last request.
            reason: reason of its refusal.
        """
        safety, health = self._safeties.newest(), self._healths.newest()
        if isinstance(safety, wire.Safety):
            self.safety = safety
            if safety.valid:
                self._received_ns = now_ns
        if isinstance(health, wire.Health):
            self.health = health
        first, *_ = self._tracks.values()
        estimate = first.at(now_ns - CYCLE_DONE_NS)
        phase_ratio, received_ns = estimate.get("gait_phase_ratio", math.nan), self._received_ns
        return Situation(
            now_s=(now_ns - began_ns) * 1e-9,
            received_s=None if received_ns is None else (received_ns - began_ns) * 1e-9,
            mode=self.safety.mode if self.safety else None,
            verdict=verdict_text(self.safety),
            phase_ratio=None if math.isnan(phase_ratio) else phase_ratio,
            artificial=bool(estimate.get("is_artificial")),
            lease_holder=self.safety.lease_holder if self.safety else None,
            outcome=outcome,
            reason=reason,
        )

    def newest_ns(self) -> int | None:
        """Return the time up to which each leg was heard; None: one is silent."""
        if len(self._newest_ns) < len(self._tracks):
            return None
        newest_ns = min(self._newest_ns.values())
        return None if self._clock.now_ns() - newest_ns >= FRESH_NS else newest_ns

    def _on_estimate(self, message: wire.Estimate | NotValid) -> None:
        if isinstance(message, NotValid):
            return
        values = (math.nan if value is None else value for value in MEASURED_OF(message))
        is_artificial = float("artificial" in message.status)
        sync_ns = message.sample_time_ns - self._clock.utc_ahead_ns()
        self._tracks[message.leg].add(sync_ns, (*values, is_artificial))
        self._newest_ns[message.leg] = sync_ns


def _keep(stream: Stream[T], kept: list[T]) -> None:
    stream.call(lambda one: None if isinstance(one, NotValid) else kept.append(one))


def verdict_text(safety: wire.Safety | None) -> str:
    """The latched verdict in one line; empty if there is none."""
    verdict = safety.verdict if safety else None
    if verdict is None or verdict.cause == "none":
        return ""
    return f"{verdict.category} {TEXTS.verdict(verdict)}"


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
        """Read the last lines, and close the file."""
        self.read()
        if self._file is not None:
            self._file.close()
