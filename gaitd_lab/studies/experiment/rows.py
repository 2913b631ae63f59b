"""What is measured of one run, as lines of a table; `study.py` summarises several runs."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from analysis.accuracy import moving
from gaitd_lab.studies.experiment.measures import (
    CROSS_S,
    START_S,
    Flags,
    Marks,
    Row,
    Run,
    covered,
    cross_talk,
    fall_s,
    largest,
    own_effect,
    peak,
    rms,
    settled_s,
    transfer,
)
from observer.filter.leg_observer import Setup
from observer.filter.status import Status, Validity
from observer.mechanism.friction import FrictionParameters, static_friction_of

Frictions = tuple[FrictionParameters, FrictionParameters]
Pair = tuple[float | None, float | None]

EFFORT: Final = ("N·m", "N")
POSITION: Final = ("µrad", "µm")
VELOCITY: Final = ("mrad/s", "mm/s")
PERCENT: Final = ("%", "%")
MICRO: Final = 1e6
MILLI: Final = 1e3
SETTLED_SHARE: Final = 0.1
"""Friction is found when its error is smaller than this share of the Coulomb level."""


def rows(run: Run, marks: Marks, frictions: Frictions, setup: Setup) -> tuple[Row, ...]:
    """List all lines of the table.

    Args:
        run: as played.
        marks: times of its scenario.
        frictions: friction of the plant; defines motion.
        setup: the observer's arguments, for rows that need a replay.
    """
    judged = run.between(START_S, np.inf)
    open_gate = moving(judged.true_velocity, frictions)
    return (
        *_peak_rows(run, marks),
        *_motion_rows(judged, open_gate),
        *_effort_rows(judged, open_gate),
        *_friction_rows(judged, open_gate, frictions),
        *_undisturbed_rows(judged, open_gate, marks),
        *_time_rows(run, marks, moving(run.true_velocity, frictions)),
        *_replayed_rows(run, marks, setup),
        *_coverage_rows(judged, open_gate),
    )


def _peak_rows(run: Run, marks: Marks) -> Iterator[Row]:
    found = peak(run, marks)
    true = estimated = percent = lag_count = None
    if found is not None:
        true, estimated = found.true_rad_per_s, found.estimated_rad_per_s
        percent, lag_count = 100 * found.difference_ratio, found.lag_count
    yield Row("velocity peak, true", true, None, "rad/s", "")
    yield Row("velocity peak, estimated", estimated, None, "rad/s", "")
    yield Row("velocity peak, difference", percent, None, "%", "")
    yield Row("velocity peak, lag", lag_count, None, "samples", "")


def _motion_rows(run: Run, open_gate: Flags) -> Iterator[Row]:
    position = MICRO * (run.state[:, :2] - run.true_position)
    velocity = MILLI * (run.state[:, 2:4] - run.true_velocity)
    differences = MILLI * (run.derivative - run.true_velocity)
    estimated, naive = both(velocity), both(differences)
    yield Row("position, rms error", *both(position), *POSITION)
    yield Row("velocity, rms error", *estimated, *VELOCITY)
    yield Row("velocity, rms error in motion", *both(velocity, open_gate), *VELOCITY)
    yield Row("velocity by differences, rms error", *naive, *VELOCITY)
    hip, slide = (
        None if one is None or other is None else other / one
        for one, other in zip(estimated, naive, strict=True)
    )
    yield Row("velocity, times better than differences", hip, slide, "", "")


def _effort_rows(run: Run, open_gate: Flags) -> Iterator[Row]:
    friction = run.state[:, 4:6] - run.true_friction
    patient = run.state[:, 6:8] - run.artificial
    shown = run.validity == Validity.OK
    for name, error in (("friction", friction), ("disturbance", patient)):
        yield Row(f"{name}, rms error in motion", *both(error, open_gate), *EFFORT)
        yield Row(f"{name}, rms error where shown", *both(error, shown), *EFFORT)
        yield Row(f"{name}, rms error with rest", *both(error), *EFFORT)
    net = run.net - (run.artificial - run.true_friction)
    yield Row("net effort, rms error", *both(net), *EFFORT)


def _friction_rows(run: Run, open_gate: Flags, frictions: Frictions) -> Iterator[Row]:
    estimated = run.state[:, 4:6]
    static = np.column_stack(
        [
            [static_friction_of(friction, speed) for speed in speeds.tolist()]
            for friction, speeds in zip(frictions, run.true_velocity.T, strict=True)
        ]
    )
    yield Row(
        "friction, rms from the static law in motion", *both(estimated - static, open_gate), *EFFORT
    )
    held = (largest(estimated[~open_gate[:, axis], axis]) for axis in range(2))
    hip, slide = (
        None if one is None else 100 * one / friction.stribeck
        for one, friction in zip(held, frictions, strict=True)
    )
    yield Row("friction at rest, largest over breakaway", hip, slide, *PERCENT)
    found = [
        settled_s(run, axis, open_gate[:, axis], SETTLED_SHARE * friction.coulomb)
        for axis, friction in enumerate(frictions)
    ]
    hip, slide = (None if one is None else MILLI * one for one in found)
    yield Row("friction found after motion begins, median", hip, slide, "ms", "ms")


def _undisturbed_rows(run: Run, open_gate: Flags, marks: Marks) -> Iterator[Row]:
    """Rows of the time before an axis has a disturbance of its own."""
    before = np.column_stack([run.time_s < one for one in (marks.sine_s, marks.onset_s)])
    shown = run.validity == Validity.OK
    velocity = MILLI * (run.state[:, 2:4] - run.true_velocity)
    friction, patient = run.state[:, 4:6] - run.true_friction, run.state[:, 6:8]
    yield Row("undisturbed: velocity, rms error", *both(velocity, before), *VELOCITY)
    yield Row(
        "undisturbed: friction, rms error in motion", *both(friction, before & open_gate), *EFFORT
    )
    yield Row("undisturbed: disturbance, rms where shown", *both(patient, before & shown), *EFFORT)


def _time_rows(run: Run, marks: Marks, open_gate: Flags) -> Iterator[Row]:
    found = transfer(run, marks, open_gate)
    reached_s = motion_s = after_motion_s = None
    if found is not None:
        reached_s, motion_s = found.reached_s, found.motion_s
        after_motion_s = found.after_motion_s
    for name, seconds in (
        ("step at rest: 90 % after its onset", reached_s),
        ("step at rest: motion after its onset", motion_s),
        ("step at rest: 90 % after motion", after_motion_s),
        ("step gone in motion: 90 % after", fall_s(run, marks)),
    ):
        yield Row(name, None, None if seconds is None else round(MILLI * seconds, 3), "", "ms")
    at_onset = run.between(marks.onset_s, marks.onset_s + (motion_s or 0.0))
    step = at_onset.artificial[:, 1] != 0
    taken = (at_onset.true_friction - at_onset.state[:, 4:6])[step, 1] / at_onset.artificial[
        step, 1
    ]
    share = 100 * float(np.max(taken)) if len(taken) else None
    yield Row("step at rest: most that friction takes of it", None, share, "", "%")
    after = run.between(marks.offset_s, marks.offset_s + CROSS_S)
    error = largest((after.state[:, 4:6] - after.true_friction)[:, 1])
    yield Row("step gone in motion: friction, largest error", None, error, "", "N")


def _replayed_rows(run: Run, marks: Marks, setup: Setup) -> Iterator[Row]:
    yield Row("cross talk from the other axis", *cross_talk(run, marks, setup), *EFFORT)
    changes = own_effect(run, marks, setup)
    yield Row("friction, rms change by the own disturbance", *changes, *EFFORT)


def _coverage_rows(run: Run, open_gate: Flags) -> Iterator[Row]:
    nis = run.nis[np.isfinite(run.nis)]
    mean = float(np.mean(nis)) if len(nis) else None
    yield Row("NIS, mean of both axes; 2 is ideal", mean, None, "", "")
    gated = int(np.count_nonzero(run.status & Status.GATED))
    yield Row("samples rejected", gated, None, "", "")
    error = run.state[:, 6:8] - run.artificial
    for name, rows_in in (("shown", run.validity == Validity.OK), ("all", np.isfinite(error))):
        inside = [
            covered(error[rows_in[:, axis], axis], run.std[rows_in[:, axis], 6 + axis])
            for axis in range(2)
        ]
        hip, slide = (None if one is None else 100 * one for one in inside)
        yield Row(f"disturbance within 3σ, {name} samples", hip, slide, *PERCENT)
    hip, slide = (100 * (1 - open_gate.mean(axis=0))).tolist()
    yield Row("time at rest", hip, slide, *PERCENT)
    yield Row("time at rest, slide more than hip", None, slide - hip, "", "%")


def both(error: np.ndarray, rows_in: Flags | None = None) -> Pair:
    """RMS of each axis, of all rows or of some."""
    hip, slide = (
        rms(error[:, axis] if rows_in is None else error[rows_in[:, axis], axis])
        for axis in range(2)
    )
    return hip, slide
