"""Output of estimates: the results of a replay, and their CSV columns.

Every existing number is written, also where the status says that the split between friction and
patient is not observable; a missing number is an empty cell. Nine significant digits hold a
resolution of 1e-9 rad; time keeps all of its digits.

Python's own formatting writes a row in 6 µs, which is as long as the observer needs to compute it.
"""

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.recording import Progress
from observer.filter.states import STATE_NAMES
from observer.offline.batch import BatchEstimates

COLUMNS: Final = (
    "time_s",
    *STATE_NAMES,
    *(f"{state}_std" for state in STATE_NAMES),
    "hip_net_nm",
    "slide_net_n",
    "nis",
    "status",
)
ROW: Final = "%r" + ",%.9g" * (len(COLUMNS) - 2) + ",0x%04x\n"
CHUNK_ROWS: Final = 8192


def write_csv(
    time_s: NDArray[np.float64],
    estimates: BatchEstimates,
    path: Path,
    progress: Progress | None = None,
) -> None:
    """Write estimates with the columns of COLUMNS.

    Args:
        time_s: shape (n,), as recorded.
        estimates: estimates of the same n rows.
        path: replaced if it exists.
        progress: called with the share done.

    Raises:
        OSError: the file cannot be written.
    """
    count = len(time_s)
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(",".join(COLUMNS) + "\n")
        for start in range(0, count, CHUNK_ROWS):
            rows = slice(start, start + CHUNK_ROWS)
            parts = (time_s, estimates.state, estimates.std, estimates.net, estimates.nis)
            numbers = np.column_stack([part[rows] for part in parts]).tolist()
            status = estimates.status[rows].tolist()
            lines = [ROW % (*row, bits) for row, bits in zip(numbers, status, strict=True)]
            file.write("".join(lines).replace("nan", ""))
            if progress:
                progress(min((start + CHUNK_ROWS) / count, 1.0))
