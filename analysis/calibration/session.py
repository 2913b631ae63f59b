"""A calibration from recordings to verdict, without files, text output and pictures."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from types import MappingProxyType
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from analysis.calibration.advice import slower_than_gait
from analysis.calibration.bristles import not_identified, with_bristles
from analysis.calibration.empty_check import Check, check, judge, refuse_wrong_branch
from analysis.calibration.fit import (
    AS_GOOD_WITHOUT,
    FOLLOWS,
    Fit,
    Progress,
    Result,
    fit,
    without,
)
from analysis.calibration.likelihood import FINE_SUBSTEPS, Flags, Likelihood
from analysis.calibration.motion import Motion, prepare
from analysis.calibration.process_noise import (
    law_uncertainty,
    process_noise,
    with_process_noise,
)
from analysis.calibration.quantities import (
    AXES,
    CANDIDATES,
    COUNT,
    KEYS,
    LAW_SIZE,
    Frame,
    frame_of,
    labelled,
    natural_values,
)
from analysis.calibration.start import extent
from analysis.calibration.transmission import (
    RIGID,
    GivesWay,
    loose_axes,
    of_joints,
    outside_gaps,
    results_of,
    softness,
    stated,
    ways_of,
)
from analysis.calibration.uncertainty import uncertainties
from analysis.calibration.verdict import (
    Disturbance,
    Score,
    disturbance,
    like_fitted,
    no_better_than_eq_11,
    other_effect,
    outside_swings,
    score,
    two_optima,
    why_needless,
    without_contact_rows,
    worse_axis,
)
from analysis.recording import RecordingError
from analysis.replay import Source
from daemon.config.edits import Value
from daemon.config.robot import friction_over_position, friction_parameters, leg_parameters
from daemon.config.settings import MissedLimit, Robot
from observer.filter.leg_model import integrator_named, substeps_needed
from observer.filter.status import START_RATIO_MIN, Status
from observer.mechanism.friction import levels_of
from observer.mechanism.mechanism import smallest_inertia

WIDER_BEHIND_GAP: Final = (2.0, 2.0, 2.0, 10.0, 10.0, 10.0, 10.0)
"""Factors on the intervals of levels and shape of a law behind a gap, in the order of its values:
how a shaft crosses the gap is in no model. Virtual axes were off by up to 1.5 times the interval in
the levels, and 8.2 times in the edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Result of a calibration."""

    motion: Motion
    """Motion of the joints, without windup."""
    given_check: Check
    """Check of the mechanism with the values of the file."""
    check: Check
    """The same with the fitted values; it decides."""
    fit: Fit
    transmission: tuple[Result, ...]
    """Stiffness and backlash of both transmissions."""
    robot: Robot
    seen_before: Disturbance
    seen_after: Disturbance
    before: Score
    after: Score
    held_out: str
    """Data that the scores belong to."""
    too_slow: tuple[str, ...]
    """Axes whose inertia the held-out data do not judge, each with what to record."""
    missed: tuple[tuple[MissedLimit, str], ...]
    """Limits that the result misses, each with the reason; empty if it may be used."""
    needless: str
    """Reason why the file to begin with is as good; empty if the new one is better."""
    contact_s: NDArray[np.float64]
    """Times of excluded rows: a short contact, for instance with an end stop."""
    process_noise: Mapping[str, float]
    """Noise of process and law by key of [observer]; empty if it stays the file's."""
    uncertainty: Mapping[str, float]
    """One standard deviation by dotted key, where it is not the file's."""
    tuning: Mapping[str, Value]
    """What the observer needs for bristles, by dotted key; empty if the file has it."""
    bristled: bool
    """True if bristles replace eq. (11): they describe the held-out data better."""
    other_law: Score | None
    """Score of the law that was fitted to the same rows and is not used; None if the file has
    bristles, with which alone it is calibrated."""
    why_eq_11: str
    """Why bristles are not used; empty if they are, or were not tried."""
    behind_gap: tuple[str, ...]
    """Axes that moved and have backlash, behind which no bristles are tried."""

    @property
    def refused(self) -> str:
        """Reasons why nothing may be written; empty if it may be."""
        return "; ".join(reason for _, reason in self.missed)

    @property
    def results(self) -> tuple[Result, ...]:
        """Results of all quantities."""
        return (*self.fit.results, *self.transmission)

    def values(self, source: str) -> Mapping[str, tuple[Value, str]]:
        """Values to write, by dotted key, each with its provenance."""
        made: dict[str, tuple[Value, str]] = {
            key: (value, "bristles need it") for key, value in self.tuning.items()
        }
        for index, one in enumerate(self.results):
            if one.calibrated:
                made[one.quantity.key] = (
                    one.value,
                    f"calibrated from {source}, 95 % ± {one.half_interval:.2g}",
                )
            elif index in FOLLOWS and one.value != one.before:
                with_it = labelled(FOLLOWS[index])
                made[KEYS[index]] = (one.value, f"follows {with_it}, calibrated from {source}")
        for key, std in self.process_noise.items():
            made[f"observer.{key}"] = (std, f"calibrated from {source}")
        for key, std in self.uncertainty.items():
            made[key] = (std, f"calibrated from {source}, one standard deviation")
        return made


def empty_run(sources: Sequence[Source], robot: Robot) -> Motion:
    """Prepare recordings of the empty machine; unsuitable ones are refused.

    Raises:
        RecordingError: a patient or an artificial disturbance is in them, they are too short or of
            a wrong rate, the mechanism does not close where they begin, or nothing moves.
    """
    for one in sources:
        if one.robot is not None and one.robot.patient is not None:
            raise RecordingError(
                f"{one.recording.source}: was recorded with a patient in the machine; calibrate "
                "from a recording of the empty machine"
            )
        if one.caller_bits is not None and np.any(one.caller_bits & Status.ARTIFICIAL):
            raise RecordingError(
                f"{one.recording.source}: has an artificial disturbance in it (excite with "
                "`artificial`); calibrate from a scenario without"
            )
    if robot.patient is not None:
        raise RecordingError(
            "the robot file has a [patient]; calibrate with the empty machine's file, such as "
            "robot_empty.toml"
        )
    if robot.observer.viscous_outside:
        raise RecordingError(
            "the robot file has viscous_outside = true; calibration fits the law with viscous "
            "friction inside eq. (11): set it to false and calibrate"
        )
    motion = _prepared(sources, robot)
    refuse_wrong_branch(robot, motion)
    return motion


def calibrate(
    sources: Sequence[Source],
    robot: Robot,
    held_out: Sequence[Source] = (),
    progress: Progress = lambda _words, _share: None,
    *,
    with_noise: bool = False,
) -> Calibration:
    """Fit, check the mechanism, and compare with the old file on held-out data.

    Bristles are fitted, too, on the axes that move, have none and no backlash, and replace eq. (11)
    if they describe the held-out data better. So does a slope of friction over position, an offset
    of effort, or a transmission that gives way, of each axis.

    Args:
        sources: recordings of the empty machine.
        robot: of the initial file.
        held_out: other recordings to compare on; without them every fourth two seconds are held
            out.
        progress: called with a text and the share done.
        with_noise: calibrate the observer's process noise, too.

    Raises:
        RecordingError: see `empty_run` and `process_noise`.
    """
    motion = empty_run(sources, robot)
    other = empty_run(held_out, robot) if held_out else None
    if other is not None:
        motion = _prepared(sources, robot, hold_out=False)
    old = frame_of(robot, middle_of(motion))
    judged = motion if other is None else other
    rows = motion.held_out if other is None else np.ones(len(judged.time_s), dtype=np.bool_)
    given_way = stated(robot)
    fitted, way, transmission = _behind_transmissions(robot, motion, progress, judged, rows)
    loose = loose_axes(way)
    joints = of_joints(motion, robot, way)
    # All files are judged on the same rows.
    unseen = {*loose, *loose_axes(given_way)}
    judged_joints, judged_given = (
        outside_gaps(of_joints(judged, robot, one), judged, robot, unseen)
        for one in (way, given_way)
    )
    if kept := _as_good_without(fitted, joints, progress, judged_joints, rows):
        rival = fitted.rival
        fitted = replace(_fit(robot, robot, joints, progress, fitted, kept), rival=rival)
    fitted = _wider_behind_gaps(fitted, loose)
    old_natural = like_fitted(old, fitted.natural, of_joints(motion, robot, given_way))
    laws = [
        _Law(robot, old, old_natural, judged_given),
        _Law(
            with_values(robot, (*fitted.results, *transmission)),
            fitted.frame,
            fitted.natural,
            judged_joints,
        ),
    ]
    made, tuning, why_eq_11 = fitted, dict[str, Value](), ""
    moved = [axis for axis in range(2) if extent(motion, axis).enough(axis)]
    given = [axis for axis in moved if not old.bristled(axis) and axis not in loose]
    if given:
        start, tuning = with_bristles(robot, given)
        try:
            made = _wider_behind_gaps(_fit(start, robot, joints, progress, fitted, kept), loose)
            bristly = with_values(start, (*made.results, *transmission))
            laws.append(_Law(bristly, made.frame, made.natural, judged_joints))
            why_eq_11 = _too_steep(laws[-1].robot)
        except RecordingError as error:
            why_eq_11 = str(error)
    # What windup explains is no other effect. It is a false effort of the observer, though.
    seen = judged_seen = [one.disturbance(joints) for one in laws]
    if judged is not joints:
        judged_seen = [one.disturbance(judged) for one in laws]
    seen = [outside_swings(one, motion, robot, loose) for one in seen]
    seen, contact = _quiet(seen, fitted.natural)
    judged_seen, _ = _quiet(judged_seen, fitted.natural)
    scores = [
        score(one.frame, one.natural, one.judged, rows, seen_by)
        for one, seen_by in zip(laws, judged_seen, strict=True)
    ]
    if given:
        known = [one.quantity.key for one in made.results if one.calibrated]
        why_eq_11 = why_eq_11 or not_identified(given, known)
        if not why_eq_11:
            why_eq_11 = no_better_than_eq_11(scores[1], scores[2], made.natural, judged)
    bristled = bool(given) and not why_eq_11
    if not bristled:
        made, tuning = fitted, {}
    used = 2 if bristled else 1
    new, before, after = laws[used].robot, scores[0], scores[used]
    if steep := _too_steep(new):
        raise RecordingError(steep)
    checked = judge(robot, new, joints)
    needless = why_needless(before, after)
    found: dict[MissedLimit, str] = {
        "mechanism": "" if checked.well else f"{checked}; correct that in the robot file",
        "two_optima": two_optima(rival) if (rival := made.rival()) else "",
        "other_effect": other_effect(seen[used], made.natural, motion, new),
        "false_effort": "" if needless else worse_axis(before, after, made.natural, judged),
    }
    noise: dict[str, float] = {}
    if with_noise:
        # Wider noise means more false effort from the same law, so the law is judged without it.
        seen_motion = outside_gaps(motion, motion, robot, loose)
        noise = process_noise(new, seen_motion, made.natural)
        noise |= law_uncertainty(with_process_noise(new, noise), seen_motion)
        new = with_process_noise(new, noise)
        widened = laws[used]._replace(robot=new).disturbance(judged)
        after = score(made.frame, made.natural, judged_joints, rows, widened)
    words = "every fourth two seconds" if other is None else ", ".join(other.sources)
    return Calibration(
        *(joints, check(robot, of_joints(motion, robot, given_way)), checked),
        *(made, transmission, new),
        *(seen[0], seen[used], before, after, words),
        tuple(slower_than_gait(judged, rows)),
        tuple((limit, reason) for limit, reason in found.items() if reason),
        needless,
        motion.time_s[contact],
        noise,
        uncertainties(robot, made.results),
        tuning,
        bristled,
        scores[3 - used] if len(scores) > 2 else None,
        why_eq_11,
        tuple(AXES[axis] for axis in moved if axis in loose),
    )


class _Law(NamedTuple):
    """A robot file to compare, with the values that only its fit has."""

    robot: Robot
    frame: Frame
    natural: NDArray[np.float64]
    judged: Motion
    """Motion of the joints that it is compared on."""

    def disturbance(self, motion: Motion) -> Disturbance:
        return disturbance(self.robot, motion)


def _fit(
    start: Robot,
    given: Robot,
    motion: Motion,
    progress: Progress,
    near: Fit | None = None,
    kept: Mapping[int, str] = MappingProxyType({}),
) -> Fit:
    """Fit from `start`, with the values before those of the given file."""
    made = fit(frame_of(start, middle_of(motion)), motion, progress, near, kept)
    before = natural_values(given).tolist()
    pairs = zip(made.results, before[:COUNT], strict=True)
    return replace(made, results=tuple(replace(one, before=value) for one, value in pairs))


def _behind_transmissions(
    robot: Robot, motion: Motion, progress: Progress, judged: Motion, rows: Flags
) -> tuple[Fit, tuple[GivesWay, GivesWay], tuple[Result, ...]]:
    """Fit the motion of the joints, which are rigid unless the recording shows windup.

    What was found counts if it describes the held-out rows better.
    """

    def fitted_behind(ways: tuple[GivesWay, GivesWay]) -> Fit:
        return _fit(robot, robot, of_joints(motion, robot, ways), progress)

    first = fitted_behind(RIGID)
    found = softness(first, motion, robot, progress)
    if found:
        # Behind a transmission that gives way the law has another optimum, which moves the way.
        found = softness(fitted_behind(ways_of(found)), motion, robot, progress, found)
    if not found:
        return first, RIGID, results_of(robot, first, found, as_good=False)
    ways = ways_of(found)
    loose = loose_axes(ways)
    second = fitted_behind(ways)

    def loss(made: Fit, ways: tuple[GivesWay, GivesWay]) -> float:
        joints = outside_gaps(of_joints(judged, robot, ways), judged, robot, loose)
        likelihood = Likelihood(made.frame, joints, rows, FINE_SUBSTEPS)
        return likelihood.surprises(made.frame.free(made.natural)).loss

    as_good = loss(first, RIGID) <= loss(second, ways)
    shown = results_of(robot, first, found, as_good=as_good)
    return (first, RIGID, shown) if as_good else (second, ways, shown)


def _wider_behind_gaps(made: Fit, loose: Iterable[int]) -> Fit:
    """The fit with wider intervals of the friction of loose axes."""
    results = list(made.results)
    for axis in loose:
        for at, wider in enumerate(WIDER_BEHIND_GAP, start=axis * LAW_SIZE):
            results[at] = replace(results[at], half_interval=wider * results[at].half_interval)
    return replace(made, results=tuple(results))


def _as_good_without(
    made: Fit, motion: Motion, progress: Progress, judged: Motion, rows: Flags
) -> dict[int, str]:
    """Candidates without which the held-out rows are described as well, with the reason."""
    likelihood = Likelihood(made.frame, judged, rows, FINE_SUBSTEPS)

    def loss(natural: NDArray[np.float64]) -> float:
        return likelihood.surprises(made.frame.free(natural)).loss

    found = loss(made.natural)
    return {
        index: AS_GOOD_WITHOUT
        for index in CANDIDATES
        if made.results[index].calibrated and loss(without(made, motion, progress, index)) <= found
    }


def _quiet(
    seen: Sequence[Disturbance], natural: NDArray[np.float64]
) -> tuple[list[Disturbance], NDArray[np.bool_]]:
    """Exclude contacts found with the new file, so that all files are scored on the same rows."""
    after, contact = without_contact_rows(seen[1], natural)
    quiet = [replace(one, moving=one.moving & ~contact[:, None]) for one in seen]
    return [quiet[0], after, *quiet[2:]], contact


def _prepared(sources: Sequence[Source], robot: Robot, *, hold_out: bool = True) -> Motion:
    delay_s = 1e-3 * robot.observer.effort_delay_ms
    return prepare([one.recording for one in sources], hold_out=hold_out, effort_delay_s=delay_s)


def middle_of(motion: Motion) -> tuple[float, float]:
    """Mean pose, rad and m."""
    hip, slide = np.mean(motion.smooth[:, :2], axis=0).tolist()
    return hip, slide


def with_values(robot: Robot, results: Sequence[Result]) -> Robot:
    """The robot with the fitted values."""
    table = msgspec.to_builtins(robot)
    for one in results:
        *path, name = one.quantity.key.split(".")
        part = table
        for step in path:
            part = part[step]
        part[name] = one.value
    try:
        return msgspec.convert(table, Robot)
    except msgspec.ValidationError as error:
        raise RecordingError(
            f"the fit ends where no robot file may ({error}): something else than friction acts in "
            "this recording; calibrate from the empty, undisturbed machine"
        ) from error


def _too_steep(robot: Robot) -> str:
    """Name the change needed if the observer cannot follow the fitted friction; empty if it can."""
    tuning = robot.observer
    inertia = smallest_inertia(leg_parameters(robot), START_RATIO_MIN)
    integrator = integrator_named(tuning.integrator)
    try:
        levels = map(levels_of, friction_parameters(robot), friction_over_position(robot))
        least = max(
            substeps_needed(hip, slide, inertia, integrator) for hip, slide in product(*levels)
        )
    except ValueError as error:
        return str(error)
    if least <= tuning.substeps:
        return ""
    return (
        f"the fitted friction is so steep that [observer] substeps must be {least}, the file has "
        f"{tuning.substeps}: change it there and calibrate again"
    )
