"""Replay: the observer over a recording from any source, with the robot of the recording.

The kernel is the service's own, in one compiled loop over all rows, so the same file gives the same
bits again. A recording with the start of the observer gives the service's own bits, but for cycles
in which the service had reason to widen the noise of an effort. A ring holds the newest 30 s only:
its replay starts with a fresh filter, and agrees with the service's estimates once the leg has
moved for some seconds.
"""

from functools import reduce
from operator import or_
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from gaitd_texts import Reader, catalogue

from analysis.recording import Progress, Recording, RecordingError, read_csv, recording
from analysis.stop_recording import about, inputs_of, observed, opened, stop_of
from daemon.config.robot import (
    considered,
    friction_parameters,
    leg_parameters,
    observer_tuning,
)
from daemon.config.settings import Robot
from observer.filter.considered import NOTHING_KNOWN, Known
from observer.filter.leg_observer import (
    CALLER_BITS,
    Setup,
    check_tuning,
    setup_of,
    with_baseline,
)
from observer.offline.batch import BatchEstimates, Columns, run
from observer.offline.smooth_batch import run_smoothed

NEITHER = "; a recording is a .csv, a folder of `gaitd record`, or a ring of records"
CALLER_MASK = int(reduce(or_, CALLER_BITS))
"""Status bits that are inputs of the observer, not its results."""


class Source(NamedTuple):
    """A recording and its metadata."""

    recording: Recording
    robot: Robot | None
    """Robot of the service; None where the recording does not contain it."""
    leg: str
    caller_bits: np.ndarray | None
    about: tuple[tuple[str, str], ...] = ()
    """Metadata of the file: names and values."""
    first_step_s: float | None = None
    """As in `Columns`; known where the recording contains the start of the observer."""


def read(path: Path, leg: str | None = None, progress: Progress | None = None) -> Source:
    """Read a `.csv`, a recording of `gaitd record`, or the black-box ring of a service.

    Args:
        path: the file or folder; any other name is read as a ring.
        leg: a leg of the recording; a CSV has only one. None only where there is but one.
        progress: called with the share read.

    Raises:
        RecordingError: the file cannot be used, or it is not said of which leg; names place and
            reason.
    """
    if leg is None and len(legs := legs_of(path)) > 1:
        raise RecordingError(f"{path}: has {' and '.join(legs)}: choose one with --leg")
    if path.suffix.lower() == ".csv":
        return Source(read_csv(path, progress), None, "", None)
    if is_recorded(path):
        from analysis import parquet  # noqa: PLC0415 - pyarrow is needed for these files alone

        found = parquet.read(path, leg)
        return Source(
            found.recording,
            found.robot,
            found.leg,
            found.status & CALLER_MASK,
            found.about,
            found.first_step_s,
        )
    return read_ring(path, leg)


def is_recorded(path: Path) -> bool:
    """Return whether a name is that of a recording of `gaitd record`, or of a part of one."""
    return path.is_dir() or path.suffix.lower() in {".parquet", ".mcap", ".part"}


def legs_of(path: Path) -> tuple[str, ...]:
    """List the legs of a recording; empty for a CSV, which has one unnamed leg.

    Raises:
        RecordingError: the file is none.
    """
    if path.suffix.lower() == ".csv":
        return ()
    if is_recorded(path):
        from analysis import parquet  # noqa: PLC0415 - as in `read`

        return tuple(parquet.files_of(path))
    with opened(path, NEITHER) as ring:
        return tuple(ring.header.leg_names)


def read_ring(path: Path, leg: str | None = None) -> Source:
    """Read a ring of records, or a file of the black box, which is one.

    The recording contains the observer's inputs and the robot.

    Raises:
        RecordingError: the file is no ring, has no such leg, or no cycle in which the observer ran.
    """
    with opened(path, NEITHER) as ring:
        header, records = ring.header, ring.since(0)
        damaged_count = ring.damaged_count
    name = leg or header.leg_names[0]
    if name not in header.leg_names:
        raise RecordingError(f"{path}: has no leg {name}, only {', '.join(header.leg_names)}")
    ran = list(observed(records, header.leg_names.index(name)))
    if not ran:
        raise RecordingError(f"{path}: the observer ran in none of its {len(records)} records")
    try:
        robot = msgspec.convert(header.robot, Robot)
    except msgspec.ValidationError as error:
        raise RecordingError(f"{path}: its robot cannot be used: {error}") from error
    said = about(stop_of(path, header, records, damaged_count), catalogue(Reader.OPERATOR, "en"))
    rows = [(time_s, *inputs_of(one)) for _, time_s, one in ran]
    bits = [one.status & CALLER_MASK for *_, one in ran]
    made = recording(str(path), np.array(rows, dtype=np.float64))
    return Source(made, robot, name, np.array(bits, dtype=np.int64), said)


def setup_for(robot: Robot, known: Known = NOTHING_KNOWN) -> Setup:
    """The observer's constant arguments for a robot, and for what a baseline says of it.

    Raises:
        TuningError: the service would not run with it either.
    """
    parts = leg_parameters(robot), *friction_parameters(robot), observer_tuning(robot)
    check_tuning(*parts)
    return with_baseline(setup_of(*parts, considered(robot)), known)


def filter_setup(robot: Robot) -> Setup:
    """The filter alone: its sigma holds nothing of [uncertainty].

    The robot may be one that the service refuses: a calibration may begin with any friction.
    """
    hip, slide = friction_parameters(robot)
    return setup_of(leg_parameters(robot), hip, slide, observer_tuning(robot))


def estimate(
    source: Source,
    robot: Robot,
    progress: Progress | None = None,
    known: Known = NOTHING_KNOWN,
) -> BatchEstimates:
    """Run the observer over the whole recording."""
    return run(setup_for(robot, known), columns_of(source), progress)


def estimate_smoothed(
    source: Source,
    robot: Robot,
    progress: Progress | None = None,
    known: Known = NOTHING_KNOWN,
) -> BatchEstimates:
    """Run observer and smoother over the whole recording."""
    return run_smoothed(setup_for(robot, known), columns_of(source), progress)


def columns_of(source: Source) -> Columns:
    """Convert a recording to the observer's input."""
    made = source.recording
    bits, step_s = source.caller_bits, source.first_step_s
    return Columns(made.time_s, made.position, made.effort, bits, step_s)


def warm_up(robot: Robot, *, smooth: bool = False) -> None:
    """Compile or load the kernels, so that this time is not part of a measured speed."""
    nothing = Columns(np.zeros(1), np.full((1, 2), np.nan), np.zeros((1, 2)))
    (run_smoothed if smooth else run)(setup_for(robot), nothing)
