"""Table of the experiment: each number beside its target.

Targets are the design's accuracy targets. "Matched" ones apply where the plant's friction is the
observer's own law, the others to a plant with bristles (LuGre), which has another structure.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from analysis.accuracy import moving
from analysis.experiment import (
    START_S,
    Flags,
    Marks,
    Row,
    Run,
    covered,
    cross_talk,
    fall_s,
    peak,
    rms,
    transfer,
)
from observer.filter.leg_observer import Setup
from observer.filter.status import Validity
from observer.mechanism.friction import FrictionParameters

Frictions = tuple[FrictionParameters, FrictionParameters]
Limits = tuple[float, float]

PEAK_MAX_PERCENT: Final = 2.0
LAG_MAX: Final = 1.0
POSITION_MAX: Final = (5e-5, 2.5e-5)
"""Half an encoder quantum of the paper-like machine that the targets were written for."""
VELOCITY_MAX: Final = (4e-3, 2e-3)
BETTER_MIN: Final = (3.0, 3.0)
FRICTION_SHARE: Final = {True: 0.01, False: 0.06}
"""Over the Coulomb level; by whether the plant has the observer's law."""
DISTURBANCE_SHARE: Final = {True: 0.05, False: 0.12}
"""Over the disturbance's peak."""
NET_MAX: Final = (0.2, 2.0)
FALL_MAX_MS: Final = 60.0
TRANSFER_MAX_MS: Final = 100.0
CROSS_MAX: Final = (0.25, 2.0)

EFFORT: Final = ("N·m", "N")


def rows(
    run: Run, marks: Marks, frictions: Frictions, setup: Setup, *, matched: bool
) -> tuple[Row, ...]:
    """List all lines of the table.

    Args:
        run: as played.
        marks: times of its scenario.
        frictions: friction of the plant; defines motion, and the Coulomb levels of the targets.
        setup: the observer's arguments, for rows that need a replay.
        matched: True if the plant's friction law is the observer's.
    """
    judged = run.between(START_S, np.inf)
    open_gate = moving(judged.true_velocity, frictions)
    return (
        *_peak_rows(run, marks),
        *_motion_rows(judged, open_gate),
        *_effort_rows(judged, open_gate, frictions, matched),
        *_time_rows(run, marks, moving(run.true_velocity, frictions), setup),
        *_coverage_rows(judged, open_gate),
    )


def cells(row: Row) -> tuple[str, str, str, str]:
    """Format a line: name, hip, slide, and the target with whether it is met."""

    def number(value: float | None, unit: str) -> str:
        return "–" if value is None else f"{value:.3g} {unit}".rstrip()

    hip, slide = number(row.hip, row.hip_unit), number(row.slide, row.slide_unit)
    one_axis = (not row.hip_unit or not row.slide_unit) and (row.hip is None or row.slide is None)
    if one_axis:
        hip = "" if not row.hip_unit and row.slide_unit else hip
        slide = "" if not row.slide_unit else slide
    verdict = {None: "", True: ", met", False: ", missed"}[row.met]
    return row.name, hip, slide, f"{row.target}{verdict}"


def _peak_rows(run: Run, marks: Marks) -> Iterator[Row]:
    found = peak(run, marks)
    yield _of_hip("velocity peak, true", found and found.true_rad_per_s, "rad/s")
    yield _of_hip("velocity peak, estimated", found and found.estimated_rad_per_s, "rad/s")
    percent = found and 100 * found.difference_ratio
    good = None if percent is None else abs(percent) <= PEAK_MAX_PERCENT
    yield _of_hip("velocity peak, difference", percent, "%", "within ±2", good)
    late = found and found.lag_count
    good = None if late is None else abs(late) <= LAG_MAX
    yield _of_hip("velocity peak, lag", late, "samples", "≤ 1", good)


def _motion_rows(run: Run, open_gate: Flags) -> Iterator[Row]:
    velocity = run.true_velocity
    estimated = _both(run.state[:, 2:4] - velocity)
    naive = _both(run.derivative - velocity)
    yield _limited(
        "position, rms error", _both(run.state[:, :2] - run.true_position), POSITION_MAX, "rad", "m"
    )
    yield _limited("velocity, rms error", estimated, VELOCITY_MAX, "rad/s", "m/s")
    in_motion = _both(run.state[:, 2:4] - velocity, open_gate)
    yield Row("velocity, rms error in motion", *in_motion, "rad/s", "m/s")
    yield Row("velocity by differences, rms error", *naive, "rad/s", "m/s")
    ratios = [
        None if one is None or other is None else other / one
        for one, other in zip(estimated, naive, strict=True)
    ]
    known = [ratio for ratio in ratios if ratio is not None]
    good = all(r >= least for r, least in zip(known, BETTER_MIN, strict=False)) if known else None
    yield Row("velocity, times better", ratios[0], ratios[1], "", "", "≥ 3", good)


def _effort_rows(run: Run, open_gate: Flags, frictions: Frictions, matched: bool) -> Iterator[Row]:
    friction = run.state[:, 4:6] - run.true_friction
    patient = run.state[:, 6:8] - run.artificial
    share, coulomb = FRICTION_SHARE[matched], (frictions[0].coulomb, frictions[1].coulomb)
    limits = share * coulomb[0], share * coulomb[1]
    yield _limited("friction, rms error in motion", _both(friction, open_gate), limits, *EFFORT)
    shown = run.validity == Validity.OK
    yield Row("friction, rms error where shown", *_both(friction, shown), *EFFORT)
    yield Row("friction, rms error with rest", *_both(friction), *EFFORT)
    size = np.max(np.abs(run.artificial), axis=0) if len(run.time_s) else np.zeros(2)
    limits = (
        float(DISTURBANCE_SHARE[matched] * size[0]),
        float(DISTURBANCE_SHARE[matched] * size[1]),
    )
    moving_error = _both(patient, open_gate)
    yield _limited("disturbance, rms error in motion", moving_error, limits, *EFFORT)
    yield Row("disturbance, rms error where shown", *_both(patient, shown), *EFFORT)
    yield Row("disturbance, rms error with rest", *_both(patient), *EFFORT, "flagged", None)
    net = run.net - (run.artificial - run.true_friction)
    limit = NET_MAX if matched else None
    yield _limited("net effort, rms error", _both(net), limit, *EFFORT)


def _time_rows(run: Run, marks: Marks, open_gate: Flags, setup: Setup) -> Iterator[Row]:
    found = transfer(run, marks, open_gate)
    yield _of_slide("step at rest: 90 % after its onset", _ms(found and found.reached_s))
    yield _of_slide("step at rest: motion after its onset", _ms(found and found.motion_s))
    after = _ms(found and found.after_motion_s)
    good = None if after is None else after <= TRANSFER_MAX_MS
    yield _of_slide("step at rest: 90 % after motion", after, "≤ 100", good)
    fallen = _ms(fall_s(run, marks))
    good = None if fallen is None else fallen <= FALL_MAX_MS
    yield _of_slide("step gone in motion: 90 % after", fallen, "≤ 60", good)
    talk = cross_talk(run, marks, setup)
    yield _limited("cross talk from the other axis", talk, CROSS_MAX, *EFFORT)


def _coverage_rows(run: Run, open_gate: Flags) -> Iterator[Row]:
    nis = run.nis[np.isfinite(run.nis)]
    mean = float(np.mean(nis)) if len(nis) else None
    yield Row("NIS, mean of both axes", mean, None, "", "", "2 is ideal")
    error = run.state[:, 6:8] - run.artificial
    for name, rows_in in (("shown", run.validity == Validity.OK), ("all", np.isfinite(error))):
        inside = [
            covered(error[rows_in[:, axis], axis], run.std[rows_in[:, axis], 6 + axis])
            for axis in range(2)
        ]
        percent = [None if one is None else 100 * one for one in inside]
        title = f"disturbance within 3σ, {name} samples"
        yield Row(title, percent[0], percent[1], "%", "%", "99.7 if Gaussian")
    rest = 100 * (1 - open_gate.mean(axis=0)) if len(open_gate) else [None, None]
    yield Row("time at rest", rest[0], rest[1], "%", "%")


def _both(error: np.ndarray, rows_in: Flags | None = None) -> tuple[float | None, float | None]:
    """RMS of each axis, of all rows or of some."""
    hip, slide = (
        rms(error[:, axis] if rows_in is None else error[rows_in[:, axis], axis])
        for axis in range(2)
    )
    return hip, slide


def _of_hip(
    name: str, value: float | None, unit: str, target: str = "", met: bool | None = None
) -> Row:
    return Row(name, value, None, unit, "", target, met)


def _of_slide(name: str, value_ms: float | None, target: str = "", met: bool | None = None) -> Row:
    return Row(name, None, value_ms, "", "ms", target, met)


def _limited(
    name: str,
    values: Sequence[float | None],
    limits: Limits | None,
    hip_unit: str,
    slide_unit: str,
) -> Row:
    hip, slide = values
    if limits is None or limits == (0.0, 0.0):
        return Row(name, hip, slide, hip_unit, slide_unit)
    target = f"≤ {limits[0]:.3g}, {limits[1]:.3g}"
    pairs = [(v, most) for v, most in zip(values, limits, strict=True) if v is not None]
    good = all(value <= most for value, most in pairs) if pairs else None
    return Row(name, hip, slide, hip_unit, slide_unit, target, good)


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(1e3 * seconds, 3)
