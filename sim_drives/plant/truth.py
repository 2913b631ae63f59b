"""What really happens in the plant, for comparison only: the service never sees it.

`TruthLog` writes one row per SYNC, and on request, in real time, one every 10 ms while SYNC is
silent, with the count of the last one: what a leg does whose master has died. The first columns
are those of a recording, with the mean torque and force since the row before, so `gaitd replay`
reads the file as it is; the columns behind them are what the observer estimates, and what no
observer can know.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TextIO

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Truth:
    """The plant at one instant. Pairs are hip and slide: rad, rad/s, N·m; m, m/s, N."""

    time_ns: int
    position: Pair
    velocity: Pair
    patient: Pair
    friction: Pair
    effort: Pair
    """Of the drives."""
    contact: Pair
    """Of end stops and blocked rotors."""
    effort_impulse: Pair
    """Integral of the effort since the start: N·m s, N s."""
    sticking: tuple[bool, bool]
    programme: str
    """What the patient does."""

    @property
    def net(self) -> Pair:
        """Patient minus friction: what the observer can always tell."""
        return (self.patient[0] - self.friction[0], self.patient[1] - self.friction[1])


class TruthRow(NamedTuple):
    """One line of the file; the field names are the columns."""

    time_s: float
    """Since the first row."""
    hip_angle_rad: float
    slide_position_m: float
    hip_torque_nm: float
    """Mean since the row before."""
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
    """Of this row; the SYNC's own time, where there was one."""
    programme: str


def truth_row(truth: Truth, before: Truth, first_ns: int, sync_count: int) -> TruthRow:
    """The row of one SYNC; efforts are means since the truth `before`, which may be the same."""
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


class TruthLog:
    """Rows in memory and, with a path, in a CSV file that is complete after every row."""

    def __init__(self, path: Path | None, keep_rows: bool = True) -> None:
        """Open the file.

        Args:
            path: of the CSV file, replaced if it is there; None keeps rows in memory only.
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
        """Add a row: the plant as it was at the SYNC's instant, or while there was none."""
        first_ns = truth.time_ns if self._first_ns is None else self._first_ns
        row = truth_row(truth, self._before or truth, first_ns, sync_count)
        self._first_ns, self._before = first_ns, truth
        if self._keep_rows:
            self.rows.append(row)
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
