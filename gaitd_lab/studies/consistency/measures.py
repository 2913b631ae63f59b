"""Consistency of the observer's covariance, measured on a plant whose noise is known.

The plant is the filter's own model with the filter's own noise (Monte Carlo), or without any
(`still`, `gaps`, `drifting`), so every deviation comes from the filter. A chi-square band applies
to the mean over the runs at one instant: a consistent filter is inside at 95 % of the instants. A
mean over instants as well varies far less, so being inside proves little.

Sources: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 5.4
(NEES, NIS, whiteness).
"""

import math
from collections.abc import Iterator, Sequence
from itertools import count
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from analysis.recording import Progress
from analysis.replay_report import drift_of
from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
from daemon.config.settings import Robot
from observer import drift
from observer.filter.leg_memory import START_STD
from observer.filter.leg_model import LANES, STEP_S, LegModel, runge_kutta
from observer.filter.leg_observer import ObserverTuning, setup_of
from observer.filter.states import STATE_COUNT
from observer.filter.status import GATED_MAX_IN_A_ROW, Status
from observer.jit import kernel
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.mechanism import gravity, slide_position_for_knee
from observer.mechanism.parameters import LegParameters
from observer.offline import batch
from observer.offline.batch import BatchEstimates, Columns
from observer.quantities import Number

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

BAND: Final = 0.95
HIP_NM, SLIDE_N = 14.0, 140.0
"""Amplitude of the efforts that keep both axes moving."""
CADENCE_HZ: Final = 0.4
MID_HIP_RAD, MID_KNEE_RAD = math.radians(14.0), math.radians(22.0)
SETTLE_ROWS: Final = 100
CLEAN_SEED: Final = 11
"""Seed of the encoders' noise on a motion without process noise."""
EDGES: Final = Status.OUT_OF_WORKSPACE | Status.NEAR_SINGULAR


class Plant(NamedTuple):
    """A leg and its observer; both use the same parameters."""

    leg: LegParameters
    frictions: tuple[FrictionParameters, FrictionParameters]
    tuning: ObserverTuning
    pose: tuple[float, float]
    """Middle of the motion: rad, m."""
    load: tuple[float, float]
    """Efforts that hold it there: N m, N."""


def plant_of(robot: Robot) -> Plant:
    """Make a plant from a robot file's own model."""
    leg = leg_parameters(robot)
    pose = (MID_HIP_RAD, slide_position_for_knee(leg, MID_HIP_RAD, MID_KNEE_RAD))
    load = gravity(leg, np.array(pose))
    held = float(load[0]), float(load[1])
    return Plant(leg, friction_parameters(robot), observer_tuning(robot), pose, held)


class Band(NamedTuple):
    """Chi-square values of many runs, and the band for one instant's mean over the runs."""

    mean: Number
    low: Number
    high: Number
    inside_ratio: float
    """Share of the instants with a mean over the runs in the band; ideally BAND."""

    @property
    def inside(self) -> bool:
        """True if the mean of all is in the band of one instant: necessary, not sufficient."""
        return self.low <= self.mean <= self.high


class Consistency(NamedTuple):
    """Results of runs with the filter's own noise in the plant, both axes in motion."""

    nees: Band
    nis: Band
    nees_over_time: Vector
    """Mean over the runs, shape (steps,)."""
    nis_over_time: Vector
    within_ratio: Matrix
    """Share of the errors within 1, 2 and 3 sigma, shape (3, 8)."""
    correlation: float
    """Correlation of an innovation with the next one, mean of both axes; 0 is white."""
    discarded_count: int
    """Runs that do not count: noise moved the leg to the edge of its workspace."""


def monte_carlo(
    plant: Plant, runs: int, steps: int, progress: Progress | None = None
) -> Consistency:
    """Measure NEES, NIS, coverage and whiteness with both axes in motion.

    Args:
        plant: its process and measurement noise are those of its tuning.
        runs: number of runs, each seeded by its number.
        steps: cycles of each run, SETTLE_ROWS of which do not count.
        progress: called with the share done.
    """
    nees, nis = np.empty((runs, steps)), np.empty((runs, steps))
    within, correlation, discarded = np.zeros((3, STATE_COUNT)), 0.0, 0
    played_runs = _runs_inside(plant, steps)
    for run in range(runs):
        truth, estimates, passed = next(played_runs)
        discarded += passed
        nees[run] = _nees(truth, estimates)
        nis[run] = estimates.nis
        rows = slice(SETTLE_ROWS, None)
        sigmas = np.abs(truth - estimates.state)[rows] / estimates.std[rows]
        within += [np.mean(sigmas <= k, axis=0) for k in (1, 2, 3)]
        correlation += _correlation(estimates.innovation[rows])
        if progress:
            progress((run + 1) / runs)
    counted = nees[:, SETTLE_ROWS:], nis[:, SETTLE_ROWS:]
    return Consistency(
        _band(counted[0], STATE_COUNT, runs),
        _band(counted[1], 2, runs),
        nees.mean(axis=0),
        nis.mean(axis=0),
        within / runs,
        correlation / runs,
        discarded,
    )


def _runs_inside(plant: Plant, steps: int) -> Iterator[tuple[Matrix, BatchEstimates, int]]:
    """Yield runs inside the workspace, seed by seed, with the number of discarded ones before."""
    discarded = 0
    for seed in count(1000):
        truth, estimates = _noisy_run(plant, np.random.default_rng(seed), steps)
        if np.isfinite(truth).all() and not np.any(estimates.status & EDGES):
            yield truth, estimates, discarded
            discarded = 0
        else:
            discarded += 1


def _band(values: Matrix, freedom: int, runs: int) -> Band:
    """Compute the band of one instant's mean over the runs, and the share of means inside."""
    half = (1.0 - BAND) / 2.0
    low, high = chi2.ppf((half, 1.0 - half), freedom * runs) / runs
    instants = values.mean(axis=0)
    inside = np.mean((instants >= low) & (instants <= high))
    return Band(float(np.mean(values)), float(low), float(high), float(inside))


def _noisy_run(
    plant: Plant, random: np.random.Generator, steps: int
) -> tuple[Matrix, BatchEstimates]:
    efforts = moving_efforts(plant, steps)
    shocks = random.normal(size=(steps, STATE_COUNT)) * plant.tuning.process_std
    start = np.array((*plant.pose, *(0.0,) * 6)) + random.normal(size=STATE_COUNT) * START_STD
    truth = played(plant, efforts, shocks, start, 2)
    noise = random.normal(size=(steps, 2)) * plant.tuning.measurement_std
    return truth, observed(plant, truth[:, :2] + noise, efforts)


def _nees(truth: Matrix, estimates: BatchEstimates) -> Vector:
    covariance = np.zeros((len(truth), STATE_COUNT, STATE_COUNT))
    rows, columns = np.tril_indices(STATE_COUNT)
    covariance[:, rows, columns] = covariance[:, columns, rows] = estimates.covariance
    error = truth - estimates.state
    weighted = np.linalg.solve(covariance, error[..., None])[..., 0]
    return np.asarray(np.sum(error * weighted, axis=1), dtype=np.float64)


def _correlation(innovation: Matrix) -> float:
    centred = innovation - innovation.mean(axis=0)
    lagged = np.sum(centred[1:] * centred[:-1], axis=0) / np.sum(centred**2, axis=0)
    return float(np.mean(lagged))


# --- without noise in the plant ------------------------------------------------------------------


class Rest(NamedTuple):
    """Result of a minute at rest."""

    time_s: Vector
    estimates: BatchEstimates
    patient_rms: tuple[float, float]
    """False patient effort: N m, N."""


def still(plant: Plant, seconds: float = 60.0, seed: int = 7) -> Rest:
    """Observe the leg at rest in equilibrium, with encoder noise."""
    rows = round(seconds / STEP_S)
    random = np.random.default_rng(seed)
    position = np.array(plant.pose) + random.normal(size=(rows, 2)) * plant.tuning.measurement_std
    estimates = observed(plant, position, np.tile(plant.load, (rows, 1)))
    hip, slide = np.sqrt(np.mean(estimates.state[:, 6:8] ** 2, axis=0)).tolist()
    return Rest(time_of(rows), estimates, (hip, slide))


class Gap(NamedTuple):
    """Motion without samples: the worst of many such gaps."""

    duration_s: float
    error: tuple[float, float]
    """Largest error of the predicted position at its end: rad, m."""
    sigmas: tuple[float, float]
    """Largest error over its standard deviation, anywhere in a gap."""
    end_sigmas: tuple[float, float]
    """The same at the end of a gap."""
    growth: tuple[float, float]
    """Smallest ratio of the standard deviation at the end to that at the beginning."""


def gaps(
    plant: Plant, durations_s: tuple[float, ...] = (0.1, 0.3, 0.5), seed: int = CLEAN_SEED
) -> list[Gap]:
    """Test gaps at many places of an excited motion, one at a time."""
    efforts = moving_efforts(plant, 900)
    truth, position = _clean(plant, efforts, seed)
    return [_gap(plant, truth, position, efforts, duration_s) for duration_s in durations_s]


def _gap(plant: Plant, truth: Matrix, position: Matrix, efforts: Matrix, duration_s: float) -> Gap:
    cycles = round(duration_s / STEP_S)
    errors, sigmas, ends, growths = [], [], [], []
    for start in range(300, 800, 23):
        lost = position.copy()
        lost[start : start + cycles] = np.nan
        estimates = observed(plant, lost, efforts)
        inside = slice(start, start + cycles)
        error = np.abs(estimates.state - truth)[inside, :2]
        errors.append(error[-1])
        ratio = error / estimates.std[inside, :2]
        sigmas.append(np.max(ratio, axis=0))
        ends.append(ratio[-1])
        growths.append(estimates.std[inside, :2][-1] / estimates.std[start - 1, :2])
    return Gap(
        duration_s,
        _pair(np.max(errors, axis=0)),
        _pair(np.max(sigmas, axis=0)),
        _pair(np.max(ends, axis=0)),
        _pair(np.min(growths, axis=0)),
    )


class Drifted(NamedTuple):
    """Result of the drift monitor when friction differs from the file."""

    level_ratio: float
    """True Coulomb and breakaway friction over those of the file."""
    correlation: tuple[float, float]
    friction_error: tuple[float, float]
    """Friction error found by the monitor, N m and N; positive above the file's."""
    true_error: tuple[float, float]


def drifting(
    plant: Plant, level_ratios: tuple[float, ...], seed: int = CLEAN_SEED
) -> list[Drifted]:
    """Run the drift monitor on an empty machine in motion, for several true friction levels."""
    return [_drifted(plant, ratio, seed) for ratio in level_ratios]


def _drifted(plant: Plant, ratio: float, seed: int) -> Drifted:
    hip, slide = (
        f._replace(stribeck=f.stribeck * ratio, coulomb=f.coulomb * ratio) for f in plant.frictions
    )
    efforts = moving_efforts(plant, 2500)
    _, position = _clean(plant._replace(frictions=(hip, slide)), efforts, seed)
    found = drift_of(observed(plant, position, efforts), plant.frictions, STEP_S)
    return Drifted(
        ratio,
        _pair([drift.correlation(one) for one in found]),
        _pair([drift.friction_error(one) for one in found]),
        _pair([(ratio - 1.0) * f.coulomb for f in plant.frictions]),
    )


class Offset(NamedTuple):
    """Result of an encoder offset that begins at one cycle and stays."""

    offset_rad: float
    believed_after_cycles: int
    flagged: bool
    """GATED until it is accepted, then INCONSISTENT."""
    valid_after_cycles: int


def offsets(plant: Plant, sizes_rad: tuple[float, ...] = (0.01, 0.1)) -> list[Offset]:
    """Measure the reaction to a lasting offset of the hip's encoder."""
    return [_offset(plant, size_rad) for size_rad in sizes_rad]


def _offset(plant: Plant, size_rad: float) -> Offset:
    rows, at = 300, 150
    position = np.tile(plant.pose, (rows, 1))
    position[at:, 0] += size_rad
    estimates = observed(plant, position, np.tile(plant.load, (rows, 1)))
    status = estimates.status[at:]
    near = np.abs(estimates.state[at:, 0] - position[at:, 0]) < 0.1 * size_rad
    believed = int(np.argmax(near))
    gated = bool(np.all(status[: min(believed, GATED_MAX_IN_A_ROW)] & Status.GATED))
    doubted = bool(status[believed] & (Status.INCONSISTENT | Status.GATED | Status.WARM_UP))
    valid = int(np.argmax((np.arange(rows - at) >= believed) & ((status & Status.VALID) > 0)))
    return Offset(size_rad, believed, gated and doubted, valid)


# --- the plant -----------------------------------------------------------------------------


def time_of(rows: int) -> Vector:
    """Times of samples on the grid, s."""
    return np.linspace(0.0, (rows - 1) * STEP_S, rows, dtype=np.float64)


def moving_efforts(plant: Plant, steps: int) -> Matrix:
    """Efforts that keep both axes in motion about the pose, shape (steps, 2)."""
    swing = 2.0 * math.pi * CADENCE_HZ * np.arange(steps) * STEP_S
    extent = np.column_stack((HIP_NM * np.cos(swing), SLIDE_N * np.cos(swing)))
    return extent + np.array(plant.load)


def observed(plant: Plant, position: Matrix, efforts: Matrix) -> BatchEstimates:
    """Run the plant's own observer over samples and efforts, shapes (n, 2)."""
    setup = setup_of(plant.leg, *plant.frictions, plant.tuning)
    return batch.run(setup, Columns(time_of(len(position)), position, efforts))


def _clean(plant: Plant, efforts: Matrix, seed: int = CLEAN_SEED) -> tuple[Matrix, Matrix]:
    """Simulate without process noise, in fine steps; samples have encoder noise."""
    start = np.array((*plant.pose, *(0.0,) * 6))
    truth = played(plant, efforts, np.zeros((len(efforts), STATE_COUNT)), start, 20)
    noise = np.random.default_rng(seed).normal(size=(len(efforts), 2))
    return truth, truth[:, :2] + noise * plant.tuning.measurement_std


def played(plant: Plant, efforts: Matrix, shocks: Matrix, start: Vector, substeps: int) -> Matrix:
    """States of the plant at each sample, shape (n, 8); the effort of a row acts up to that row."""
    states = np.empty((len(efforts), STATE_COUNT))
    physics = (float(plant.tuning.coriolis), float(plant.tuning.viscous_outside))
    _play(plant.leg, *plant.frictions, *physics, efforts, shocks, start.copy(), substeps, states)
    return states


@kernel
def _play(
    leg: LegParameters,
    hip: FrictionParameters,
    slide: FrictionParameters,
    coriolis_share: float,
    viscous_outside: float,
    efforts: Matrix,
    shocks: Matrix,
    state: Vector,
    substeps: int,
    states: Matrix,
) -> None:
    model = LegModel(leg, hip, slide, coriolis_share, viscous_outside)
    points = np.empty(STATE_COUNT * LANES)
    for k in range(efforts.shape[0]):
        if k > 0:
            for row in range(STATE_COUNT):
                for lane in range(LANES):
                    points[row * LANES + lane] = state[row]
            for _ in range(substeps):
                runge_kutta(model, efforts[k, 0], efforts[k, 1], STEP_S / substeps, points)
            for row in range(STATE_COUNT):
                state[row] = points[row * LANES] + shocks[k, row]
        for row in range(STATE_COUNT):
            states[k, row] = state[row]


def _pair(values: Sequence[float] | Vector) -> tuple[float, float]:
    return float(values[0]), float(values[1])
