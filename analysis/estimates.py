"""Output of estimates: the results of a replay, and their CSV columns.

As in the message `estimate`, an axis at rest has neither friction nor patient, and one that is BAD
has no number at all: their cells are empty. Nine significant digits hold a resolution of 1e-9 rad;
time keeps all of its digits.

Python's own formatting writes a row in 6 µs, which is as long as the observer needs to compute it.
"""

from dataclasses import fields, replace
from pathlib import Path
from typing import Final

import numpy as np
from gaitd_names.joints import JOINTS
from gaitd_names.measured import Validity as ValidityName
from numpy.typing import NDArray

from analysis.recording import Progress
from observer.filter.states import FRICTION, STATE_NAMES
from observer.filter.status import Validity
from observer.offline.batch import BatchEstimates

COLUMNS: Final = (
    "time_s",
    *STATE_NAMES,
    *(f"{state}_std" for state in STATE_NAMES),
    "hip_net_nm",
    "slide_net_n",
    "nis",
    *(f"{axis}_validity" for axis in JOINTS),
    "status",
)
NUMBERS: Final = 2 * len(STATE_NAMES) + 3
"""Columns between the time and the validity."""
ROW: Final = "%r" + ",%.9g" * NUMBERS + ",%s,%s,0x%04x\n"
VALIDITY_NAMES: Final = np.array([ValidityName[level.name].value for level in Validity])
"""As in the messages, by the number of a level."""
CHUNK_ROWS: Final = 8192


def shown(estimates: BatchEstimates) -> BatchEstimates:
    """Estimates without the numbers that their validity excludes, which become NaN.

    Returns: state, std, net and net_std without them; everything else is the same object.
    """
    of_state = np.tile(estimates.validity, len(STATE_NAMES) // 2)
    is_split = np.arange(len(STATE_NAMES)) >= FRICTION.start
    known = (of_state == Validity.OK) | ((of_state == Validity.SPLIT_UNOBSERVABLE) & ~is_split)
    net_known = estimates.validity != Validity.BAD
    return replace(
        estimates,
        state=np.where(known, estimates.state, np.nan),
        std=np.where(known, estimates.std, np.nan),
        net=np.where(net_known, estimates.net, np.nan),
        net_std=np.where(net_known, estimates.net_std, np.nan),
    )


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
            made = shown(rows_of(estimates, rows))
            parts = (time_s[rows], made.state, made.std, made.net, made.nis)
            numbers = np.column_stack(parts).tolist()
            names = VALIDITY_NAMES[made.validity].tolist()
            columns = zip(numbers, names, made.status.tolist(), strict=True)
            lines = [ROW % (*row, *levels, bits) for row, levels, bits in columns]
            file.write("".join(lines).replace("nan", ""))
            if progress:
                progress(min((start + CHUNK_ROWS) / count, 1.0))


def rows_of(estimates: BatchEstimates, rows: slice) -> BatchEstimates:
    """Return some rows of estimates, as views."""
    return BatchEstimates(*(getattr(estimates, one.name)[rows] for one in fields(estimates)))
