"""Estimates out: what replay computes, and the CSV columns it writes them to.

Every number that there is gets written, also where the status says that the split between friction
and patient cannot be observed; a number that there is not is an empty cell. Nine significant digits
hold a resolution of 1e-9 rad; time keeps all of its digits.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.states import STATE_NAMES

COLUMNS: Final = (
    "time_s",
    *STATE_NAMES,
    *(f"{state}_std" for state in STATE_NAMES),
    "hip_net_nm",
    "slide_net_n",
    "nis",
    "status",
)
CHUNK_ROWS: Final = 8192
_LINE: Final = ",".join(["%r", *["%.9g"] * (len(COLUMNS) - 2), "0x%04x"])


@dataclass(frozen=True, slots=True, eq=False)
class Estimates:
    """What the observer said at each row of a recording."""

    source: str
    time_s: NDArray[np.float64]
    """Shape (n,)."""
    state: NDArray[np.float64]
    """Shape (n, 8), in the order of observer/states.py."""
    std: NDArray[np.float64]
    """Shape (n, 8): standard deviations of the states."""
    net: NDArray[np.float64]
    """Shape (n, 2): patient minus friction [N·m, N]."""
    net_std: NDArray[np.float64]
    """Shape (n, 2)."""
    nis: NDArray[np.float64]
    """Shape (n,): normalised innovation squared; NaN without a measurement."""
    status: NDArray[np.int64]
    """Shape (n,): bits of observer.status.Status."""
    validity: NDArray[np.int64]
    """Shape (n, 2): observer.status.Validity of hip and slide."""


def write_csv(
    estimates: Estimates, path: Path, progress: Callable[[float], None] | None = None
) -> None:
    """Write estimates with the columns of COLUMNS.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(COLUMNS) + "\n")
        for done, text in _chunks(estimates):
            file.write(text)
            if progress:
                progress(done)


def _chunks(estimates: Estimates) -> Iterator[tuple[float, str]]:
    count = len(estimates.time_s)
    for start in range(0, count, CHUNK_ROWS):
        rows = slice(start, start + CHUNK_ROWS)
        numbers = np.column_stack(
            (
                estimates.time_s[rows],
                estimates.state[rows],
                estimates.std[rows],
                estimates.net[rows],
                estimates.nis[rows],
            )
        )
        status = estimates.status[rows].tolist()
        lines = [_LINE % (*row, bits) for row, bits in zip(numbers.tolist(), status, strict=True)]
        text = "\n".join(lines) + "\n"
        yield min((start + CHUNK_ROWS) / count, 1.0), text.replace("nan", "")
