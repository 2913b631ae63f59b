"""What the audience hears: messages over Zenoh as any client gets them, and the plant's truth.

The truth comes from the file that the virtual drives write for comparison; the service never sees
it. Both are put on the monotonic clock of the core, where the SYNC of a cycle is one instant.
"""

import json
import math
from collections import deque
from io import TextIOWrapper
from pathlib import Path
from types import TracebackType
from typing import Final, Self, TypeVar

import msgspec
import numpy as np
import zenoh
from numpy.typing import NDArray

from daemon import wire
from daemon.clock import AgeClock
from gaitd.demonstration.script import Situation
from gaitd.remote import Target, client_settings
from sim_drives.truth import TruthRow

HEARD: Final = (
    *("hip_patient_nm", "slide_patient_n", "hip_patient_nm_std", "slide_patient_n_std"),
    *("hip_friction_nm", "slide_friction_n", "hip_angle_rad", "slide_position_m"),
    *("artificial_hip_nm", "artificial_slide_n"),
)
"""What is kept of an estimate; NaN where the service says null."""
TRUE: Final = ("hip_patient_nm", "slide_patient_n", "hip_friction_nm", "slide_friction_n")
"""What is kept of the truth."""
EVENTS_KEPT: Final = 100

Values = NDArray[np.float64]


Message = TypeVar("Message", bound=msgspec.Struct)


class Track:
    """Values over monotonic time, written by one thread and read by another."""

    def __init__(self, columns: tuple[str, ...]) -> None:
        """Begin empty."""
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
        """One column of what `arrays` gave."""
        return values[:, self.columns.index(name)]


class Audience:
    """A plain Zenoh client of one service: subscribes, and keeps what it hears."""

    def __init__(self, target: Target, leg: str, heard: Track, clock: AgeClock) -> None:
        """Know whom to listen to; `connect` opens the session.

        Args:
            target: where the service listens.
            leg: whose estimate is kept.
            heard: takes the columns of HEARD.
            clock: of the act.
        """
        self._clock = clock
        self.safety: wire.Safety | None = None
        self.health: wire.Health | None = None
        self.drives: dict[str, wire.DriveState] = {}
        self.events: deque[wire.Event] = deque(maxlen=EVENTS_KEPT)
        self._estimate: wire.Estimate | None = None
        self._estimate_s = -math.inf
        self._heard_s: float | None = None
        self._track = heard
        self._target, self._leg = target, leg
        self._session: zenoh.Session | None = None

    @property
    def hears_the_core(self) -> bool:
        """Whether records of a core arrive."""
        return self.safety is not None and self.safety.valid

    def connect(self) -> bool:
        """Try once; False while nobody listens."""
        if self._session is not None:
            return True
        zenoh.init_log_from_env_or("off")
        config = zenoh.Config()
        for key, value in client_settings(self._target.endpoints).items():
            config.insert_json5(key, json.dumps(value))
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError:
            return False
        self._subscribe(self._session)
        return True

    def situation(self, now_s: float, outcome: str | None, reason: str) -> Situation:
        """What the script may know at this moment."""
        safety, estimate = self.safety, self._estimate
        fresh = estimate is not None and now_s - self._estimate_s < 0.5
        return Situation(
            now_s=now_s,
            heard_s=self._heard_s,
            mode=safety.mode if safety else None,
            verdict=verdict_text(safety),
            phase_ratio=estimate.gait_phase_ratio if estimate and fresh else None,
            artificial=bool(estimate and fresh and "artificial" in estimate.status),
            outcome=outcome,
            reason=reason,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        # A session that is not closed keeps the process from ending.
        if self._session is not None:
            self._session.close()
            self._session = None

    def _subscribe(self, session: zenoh.Session) -> None:
        trainer = self._target.trainer
        for parts, callback in (
            ((self._leg, "estimate"), self._on_estimate),
            ((wire.SAFETY,), self._on_safety),
            ((wire.HEALTH,), self._on_health),
            ((wire.EVENTS,), self._on_event),
            (("drives", "**"), self._on_drive),
        ):
            session.declare_subscriber(wire.key(trainer, *parts), callback)

    def _on_estimate(self, sample: zenoh.Sample) -> None:
        message = _message(sample, wire.Estimate)
        # Both clocks are read together: the SYNC's UTC becomes monotonic time.
        now_ns = self._clock.now_ns()
        behind_ns = self._clock.utc_ns() - message.sample_time_ns
        values = tuple(
            math.nan if (value := getattr(message, name)) is None else value for name in HEARD
        )
        self._track.add(now_ns - behind_ns, values)
        self._estimate = message
        self._estimate_s = self._heard_s = now_ns * 1e-9

    def _on_safety(self, sample: zenoh.Sample) -> None:
        message = _message(sample, wire.Safety)
        self.safety = message
        if message.valid:
            self._heard_s = self._clock.now_ns() * 1e-9

    def _on_health(self, sample: zenoh.Sample) -> None:
        self.health = _message(sample, wire.Health)

    def _on_event(self, sample: zenoh.Sample) -> None:
        self.events.append(_message(sample, wire.Event))

    def _on_drive(self, sample: zenoh.Sample) -> None:
        message = _message(sample, wire.DriveState)
        self.drives[message.name] = message


def _message(sample: zenoh.Sample, kind: type[Message]) -> Message:
    return msgspec.json.decode(sample.payload.to_bytes(), type=kind)


def verdict_text(safety: wire.Safety | None) -> str:
    """The latched verdict in one line; empty if there is none."""
    verdict = safety.verdict if safety else None
    if verdict is None or verdict.cause == "none":
        return ""
    where = f" at {verdict.drive}" if verdict.drive else ""
    detail = f": {verdict.detail}" if verdict.detail else ""
    return f"{verdict.category} {verdict.text}{where}{detail}"


class TruthTail:
    """Follows the file of truth as it grows; whole lines only."""

    def __init__(self, path: Path, track: Track) -> None:
        """Follow `path`, which need not be there yet, into the columns of TRUE."""
        self._path = path
        self._track = track
        self._file: TextIOWrapper | None = None
        self._rest = ""
        self._time = TruthRow._fields.index("sync_mono_ns")
        self._values = [TruthRow._fields.index(name) for name in TRUE]

    def read(self) -> None:
        """Take in what was written since the last call."""
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
        """Stop following."""
        if self._file is not None:
            self._file.close()
            self._file = None
