"""What `gaitd replay` prints about a recording and its estimates, as lines of text."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from gaitd_names.joints import JOINTS

from analysis.column_check import suspicion
from analysis.replay import Source
from daemon.config.robot import friction_parameters
from daemon.config.settings import Robot
from observer.drift import (
    NO_DRIFT,
    SIGMAS,
    Drift,
    Sample,
    asks_for_calibration,
    correlation,
    friction_error,
    is_no_friction,
    is_offset,
    is_sloped,
    offset_allowed,
    offset_error,
    slope_error,
    updated,
)
from observer.filter.leg_model import STEP_S
from observer.filter.status import Status, Validity
from observer.mechanism.friction import FrictionParameters
from observer.offline.batch import BatchEstimates
from observer.strides import Stride

DOUBTFUL: Final = Status.ARTIFICIAL | Status.NEAR_LIMIT | Status.INPUT_SATURATED
"""Status bits under which an estimate is neither friction nor patient, as in the service."""


def recording_lines(
    source: Source, estimates: BatchEstimates, robot: str, computing_s: float, whole_s: float
) -> Iterator[str]:
    """Describe the recording, the share of valid estimates, and the speed.

    Args:
        source: the recording.
        estimates: of all its rows.
        robot: where the robot's numbers are from.
        computing_s: time of the estimation.
        whole_s: time with reading and writing.
    """
    made = source.recording
    count = len(made.time_s)
    missing = np.count_nonzero(np.isnan(made.position).any(axis=1))
    nis = estimates.nis[np.isfinite(estimates.nis) & ((estimates.status & Status.GATED) == 0)]
    for title, words in source.about:
        yield f"{title:<12} {words}"
    yield f"recording    {made.source}: {count} rows, {made.duration_s:.2f} s"
    yield f"robot        {robot}"
    yield f"missing      {missing} samples"
    for axis, levels in zip(JOINTS, estimates.validity.T, strict=True):
        ok, rest, bad = np.bincount(levels, minlength=len(Validity)) / count
        yield f"validity     {axis}: {ok:.1%} ok, {rest:.1%} at rest, {bad:.1%} bad"
    yield f"mean NIS     {np.mean(nis):.2f} (2 is ideal)" if len(nis) else "mean NIS     -"
    yield (
        f"speed        {made.duration_s / computing_s:.0f} x real time computing, "
        f"{made.duration_s / whole_s:.0f} x with reading and writing"
    )


def drift_lines(estimates: BatchEstimates, robot: Robot) -> Iterator[str]:
    """Format the drift monitor's result for the friction of each axis."""
    laws = friction_parameters(robot)
    advice = ": calibrate" if robot.patient is None else ": a patient, or time to calibrate"
    unsure = robot.uncertainty
    units = (
        ("hip", "N·m", "rad", unsure.hip.friction_slope_per_rad),
        ("slide", "N", "m", unsure.slide.friction_slope_per_m),
    )
    found = drift_of(estimates, laws, STEP_S)
    for (axis, unit, length, std), law, drift in zip(units, laws, found, strict=True):
        rho = correlation(drift)
        if math.isnan(rho):
            yield f"friction     {axis}: too little motion to tell its level"
            continue
        advised = ""
        if is_no_friction(drift, law):
            advised = ": no friction, as it is more than the law's own level"
        elif asks_for_calibration(drift, law):
            advised = advice
        yield (
            f"friction     {axis}: {friction_error(drift):+.2f} {unit} from its law, correlation "
            f"with the motion {rho:+.2f}{advised}"
        )
        if robot.patient is None and is_offset(drift):
            yield (
                f"offset       {axis}: {offset_error(drift):+.2f} {unit} beside motion and "
                f"friction, the file allows {offset_allowed(drift):.2g}: calibrate"
            )
        if robot.patient is None and is_sloped(drift, law, std):
            yield (
                f"friction     {axis}: rises along it by {slope_error(drift, law):+.2g} 1/{length} "
                f"more than the file says, which allows {SIGMAS * std:.2g}: calibrate"
            )


def column_lines(source: Source, estimates: BatchEstimates, robot: Robot) -> Iterator[str]:
    """Warn of columns that are probably swapped, or have a wrong sign."""
    found = suspicion(source, robot, estimates)
    if found is None:
        return
    other = "" if robot.patient is None else ", or the patient does more than the motion needs"
    yield (
        f"columns      probably wrong: the patient has {found.coulomb_ratio:.1f} times Coulomb "
        f"friction, but {found.arranged_ratio:.1f} with {found.arrangement.words}{other}"
    )


def drift_of(
    estimates: BatchEstimates, frictions: tuple[FrictionParameters, ...], step_s: float
) -> list[Drift]:
    """Run the drift monitor over a whole recording, axis by axis."""
    found: list[Drift] = []
    for axis, law in enumerate(frictions):
        valid = (estimates.validity[:, axis] == Validity.OK) & (estimates.status & DOUBTFUL == 0)
        one = NO_DRIFT
        rows = np.column_stack(
            (estimates.state[valid][:, (axis, 2 + axis, 6 + axis)], estimates.std[valid, 6 + axis])
        )
        for row in rows.tolist():
            one = updated(one, law, Sample(*row), step_s)
        found.append(one)
    return found


def stride_lines(
    found: Sequence[tuple[int, Stride]], files: tuple[Path | None, Path | None]
) -> Iterator[str]:
    """Describe the strides, and name the files that have them."""
    yield f"strides      {len(found)} in {' and '.join(str(path) for path in files if path)}"
    known = [stride for _, stride in found if not math.isnan(stride.work_positive_j)]
    if known:
        hip_j = sum(stride.hip.work_positive_j for stride in known) / len(known)
        slide_j = sum(stride.slide.work_positive_j for stride in known) / len(known)
        work = f"{hip_j:.2f} and {slide_j:.2f} J a stride"
        yield f"             patient's work with the motion: {work}"
