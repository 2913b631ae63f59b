"""True state of the plant, for comparison only: the service has no access to it.

`TruthLog` writes one row per SYNC. On request, in real time, it also writes one every 10 ms while
SYNC is missing, with the number of the last one, which shows the leg's motion after a failure of
the master. The first columns are those of a recording, with the mean torque and force since the row
before, so `gaitd replay` reads the file as it is; the columns behind them are what the observer
estimates, and what no observer can know.
"""

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple, TextIO

Pair = tuple[float, float]


class Truth(NamedTuple):
    """The plant at one instant. Pairs are hip and slide: rad, rad/s, N·m; m, m/s, N."""

    time_ns: int
    position: Pair
    velocity: Pair
    patient: Pair
    friction: Pair
    effort: Pair
    """Effort of the drives."""
    contact: Pair
    """Effort of end stops, of a blocked rotor, and of what leads an axis of another drive."""
    effort_impulse: Pair
    """Integral of the effort since the start: N·m s, N s."""
    sticking: tuple[bool, bool]
    programme: str
    """Effort of the patient."""

    @property
    def net(self) -> Pair:
        """Patient minus friction: the sum that the observer can always estimate."""
        return (self.patient[0] - self.friction[0], self.patient[1] - self.friction[1])


class TruthRow(NamedTuple):
    """One line of the file; the field names are the columns."""

    time_s: float
    """Time since the first row."""
    hip_angle_rad: float
    slide_position_m: float
    hip_torque_nm: float
    """Mean since the previous row."""
    slide_force_n: float
    hip_velocity_rad_per_s: float
    slide_velocity_m_per_s: float
    hip_friction_nm: float
    slide_friction_n: float
    hip_patient_nm: float
    slide_patient_n: float
    hip_net_nm: float
    slide_net_n: float
    hip_contact_nm: float
    slide_contact_n: float
    hip_sticking: int
    slide_sticking: int
    sync_count: int
    sync_mono_ns: int
    """Time of this row; the SYNC's own time, where there was one."""
    programme: str


def truth_row(truth: Truth, before: Truth, first_ns: int, sync_count: int) -> TruthRow:
    """Return the row of one SYNC; efforts are means since `before`, or of that instant."""
    span_s = (truth.time_ns - before.time_ns) * 1e-9
    torque, force = truth.effort
    if span_s > 0:
        torque = (truth.effort_impulse[0] - before.effort_impulse[0]) / span_s
        force = (truth.effort_impulse[1] - before.effort_impulse[1]) / span_s
    return TruthRow(
        (truth.time_ns - first_ns) * 1e-9,
        *truth.position,
        torque,
        force,
        *truth.velocity,
        *truth.friction,
        *truth.patient,
        *truth.net,
        *truth.contact,
        int(truth.sticking[0]),
        int(truth.sticking[1]),
        sync_count,
        truth.time_ns,
        truth.programme,
    )


def _text(value: float | str) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def truth_path(truth: Path, leg: str, legs: Collection[str]) -> Path:
    """Return a leg's file: with several legs its name ends in `_right` or `_left`."""
    return truth if len(legs) == 1 else truth.with_stem(f"{truth.stem}_{leg}")


class TruthLog:
    """Rows in memory and, with a path, in a CSV file that is complete after every row."""

    def __init__(self, path: Path | None, keep_rows: bool = True) -> None:
        """Open the file.

        Args:
            path: the CSV file, replaced if it exists; None keeps rows in memory only.
            keep_rows: keep them in `rows` too; a simulator that runs for hours does not.

        Raises:
            OSError: the file cannot be written.
        """
        self.rows: list[TruthRow] = []
        self._keep_rows = keep_rows
        self._first_ns: int | None = None
        self._before: Truth | None = None
        self._file: TextIO | None = None
        if path is not None:
            self._file = path.open("w", encoding="utf-8")
            self._write(",".join(TruthRow._fields))

    def record(self, sync_count: int, truth: Truth) -> TruthRow:
        """Add a row: the plant at the SYNC's instant, or while SYNC is missing."""
        first_ns = truth.time_ns if self._first_ns is None else self._first_ns
        row = truth_row(truth, self._before or truth, first_ns, sync_count)
        self._first_ns, self._before = first_ns, truth
        if self._keep_rows:
            self.rows.append(row)
        if self._file is not None:
            self._write(",".join(_text(value) for value in row))
        return row

    def close(self) -> None:
        """Close the file; later rows are kept in memory only."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _write(self, line: str) -> None:
        if self._file is not None:
            self._file.write(line + "\n")
            self._file.flush()
