"""All estimators in all situations.

What is tuned is tuned on the record to identify from. The bandwidth of the classical estimators is
the one with which they follow a step as fast as the calibrated observer, to 90 %; the errors at
other bandwidths are in the figure.
"""

from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import root_scalar

from analysis.calibration.fit import Progress
from analysis.calibration.process_noise import LAW_KEYS, with_process_noise
from analysis.calibration.session import Calibration, calibrate
from analysis.recording import RecordingError
from analysis.replay import Source, estimate, estimate_smoothed
from daemon.config.edits import replaced
from daemon.config.robot import friction_parameters
from daemon.config.settings import Robot
from gaitd_lab.studies.ablation.choices import CHOICES
from gaitd_lab.studies.real_data.classical import (
    Axis,
    Estimator,
    inverse_dynamics,
    momentum_observer,
)
from gaitd_lab.studies.real_data.emps import PUBLISHED_OFFSET_N, Record, published
from gaitd_lab.studies.real_data.judgement import Estimate, Score, judge, of_observer, reached_s
from gaitd_lab.studies.real_data.situations import Situation, clean, disturbed
from observer.filter.leg_model import STEP_S
from observer.smoother import LAG

PUBLISHED: Final = "gaitd, published parameters, noise of the shipped file"
CALIBRATED: Final = "gaitd, calibrated"
NOISE: Final = "gaitd, calibrated with its noise"
CERTAIN: Final = "the same, the law taken as certain"
SMOOTHED: Final = "gaitd, calibrated, smoothed (150 ms late)"
SMOOTHED_NOISE: Final = "gaitd, calibrated with its noise, smoothed"
PAPER: Final = "the paper's tuning, calibrated with its noise"
MOMENTUM: Final = "momentum observer, static friction"
INVERSE: Final = "inverse dynamics, low-pass, static friction"
PAPERS_CHOICE: Final = "paper's observer"
BANDWIDTHS_RAD_PER_S: Final = (15.0, 250.0)

Run = Callable[[Situation], Estimate]


class Comparison(NamedTuple):
    """All results."""

    calibration: Calibration
    """With the observer's noise."""
    plain: Robot
    """Calibrated, with the noise of the shipped file."""
    offset_n: float
    """Constant force found by it."""
    situations: tuple[Situation, ...]
    """As the calibrated estimators see them."""
    scores: Mapping[str, tuple[Score, ...]]
    """By estimator, in the order of the situations."""
    runs: Mapping[str, Run]
    bandwidths: Mapping[str, float]
    """Bandwidths of the classical estimators, rad/s."""
    trade: Mapping[str, tuple[tuple[float, float], ...]]
    """Classical estimators at several bandwidths: time to 90 % [s], false force [N]."""

    @property
    def mass_kg(self) -> float:
        """Calibrated mass of the carriage."""
        return self.calibration.robot.slide.drive_mass_kg


def compare(
    records: tuple[Record, Record],
    robot: Robot,
    progress: Progress = lambda _words, _share: None,
) -> Comparison:
    """Calibrate on the first record, and run every estimator over both.

    Args:
        records: to identify from, and to validate on.
        robot: of the empty machine; its mechanism is replaced by the axis.
        progress: of the calibration.

    Raises:
        RecordingError: the records cannot be used, or the calibration must not be.
    """
    first = published(robot)
    source = Source(records[0].recording, None, "", None)
    made = calibrate([source], first, progress=progress, with_noise=True)
    if why := [reason for limit, reason in made.missed if limit != "mechanism"]:
        raise RecordingError(f"{records[0].recording.source}: {'; '.join(why)}")
    offset_n = made.robot.effort_offset.slide.force_n
    given = {key: attrgetter(key)(first.observer) for key in made.process_noise}
    # Taken off the records, for the classical observers as well.
    noisy = replaced(made.robot, {"effort_offset.slide.force_n": 0.0})
    plain = with_process_noise(noisy, given)
    runs = _observers(first, plain, noisy)
    seen = {name: _situations(records, offset_n) for name in runs}
    seen[PUBLISHED] = _situations(records, PUBLISHED_OFFSET_N)
    last = seen[NOISE][-1]
    axis = Axis(made.robot.slide.drive_mass_kg, friction_parameters(made.robot)[1], STEP_S)
    wanted_s = reached_s(runs[NOISE](last).force_n, last, 0.9)
    bandwidths: dict[str, float] = {}
    trade: dict[str, tuple[tuple[float, float], ...]] = {}
    for name, method in ((MOMENTUM, momentum_observer), (INVERSE, inverse_dynamics)):
        bandwidths[name] = _as_fast(method, axis, last, wanted_s)
        runs[name] = _classical(method, axis, bandwidths[name])
        seen[name] = seen[NOISE]
        trade[name] = _trade(method, axis, last)
    scores = {
        name: tuple(judge(run(situation), situation) for situation in seen[name])
        for name, run in runs.items()
    }
    return Comparison(made, plain, offset_n, seen[NOISE], scores, runs, bandwidths, trade)


def _situations(records: tuple[Record, Record], offset_n: float) -> tuple[Situation, ...]:
    identification, validation = records
    return (
        clean(identification, offset_n),
        clean(validation, offset_n),
        disturbed(validation, offset_n),
    )


def _observers(first: Robot, plain: Robot, noisy: Robot) -> dict[str, Run]:
    paper = next(choice for choice in CHOICES if choice.name == PAPERS_CHOICE).change(noisy)

    def live(robot: Robot) -> Run:
        return lambda situation: of_observer(estimate(situation.source, robot))

    def smoothed(robot: Robot) -> Run:
        def run(situation: Situation) -> Estimate:
            made = estimate_smoothed(situation.source, robot)
            return of_observer(made)._replace(nis=None, lead_s=LAG * STEP_S)

        return run

    return {
        PUBLISHED: live(first),
        CALIBRATED: live(plain),
        NOISE: live(noisy),
        CERTAIN: live(with_process_noise(noisy, dict.fromkeys(LAW_KEYS, 0.0))),
        SMOOTHED: smoothed(plain),
        SMOOTHED_NOISE: smoothed(noisy),
        PAPER: live(paper),
    }


def _classical(method: Estimator, axis: Axis, bandwidth_rad_per_s: float) -> Run:
    def run(situation: Situation) -> Estimate:
        position_m, force_n = situation.position_m, situation.force_n
        return Estimate(method(axis, position_m, force_n, bandwidth_rad_per_s))

    return run


def _as_fast(method: Estimator, axis: Axis, situation: Situation, ninety_s: float) -> float:
    """Bandwidth with which an estimator reaches 90 % of a step in this time."""

    def slower_s(bandwidth: float) -> float:
        run = _classical(method, axis, bandwidth)
        return reached_s(run(situation).force_n, situation, 0.9) - ninety_s

    return float(root_scalar(slower_s, bracket=BANDWIDTHS_RAD_PER_S, xtol=0.1).root)


def _trade(method: Estimator, axis: Axis, situation: Situation) -> tuple[tuple[float, float], ...]:
    made: list[tuple[float, float]] = []
    for bandwidth in np.geomspace(*BANDWIDTHS_RAD_PER_S, 15).tolist():
        found = judge(_classical(method, axis, bandwidth)(situation), situation)
        made.append((found.ninety_s, found.false_n))
    return tuple(made)
