"""The smoother against a textbook, against least squares, and against itself live and offline."""

import math

import numpy as np
import pytest

from observer.filter import cdkf
from observer.filter.leg_memory import (
    BEGAN,
    NOTHING,
    STEPPED,
    N,
    new_memory,
)
from observer.filter.leg_model import LANES
from observer.filter.leg_observer import LegObserver, setup_of
from observer.leg_smoother import LegSmoother
from observer.offline import batch
from observer.offline.batch import Columns
from observer.offline.smooth_batch import run_smoothed
from observer.smoother import (
    CYCLE_DATA_COUNT,
    LAG,
    RING_SIZE,
    SMOOTH_COVARIANCE,
    SMOOTH_NET,
    SMOOTH_SIZE,
    SMOOTH_STD,
    WORK_SIZE,
    smoothed,
    store,
)
from tests.observer.trainer import (
    HIP,
    PATIENT,
    SLIDE_FRICTION,
    TUNING,
    encoded,
    gait,
    moving,
    rms,
    simulate,
)

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)
SETUP = setup_of(PATIENT, HIP, SLIDE_FRICTION, SHIPPED)


# --- on a linear system ------------------------------------------------------------------------


class Linear:
    """A linear filter made of the product's own steps, and the textbook's beside it."""

    def __init__(self, seed, process=0.3):
        random = np.random.default_rng(seed)
        self.transition = np.eye(N) + 0.2 * random.normal(size=(N, N))
        self.noise = np.diag(process * random.uniform(0.2, 1.0, N))
        self.noise[6, 4] = 0.3 * process
        self.sensor = np.array((0.05, 0.08))
        (self.memory, self.points), self.work = new_memory(), np.zeros(WORK_SIZE)
        self.ring, self.random = np.zeros(RING_SIZE), random
        self.mean, self.root = self.memory["mean"][0], self.memory["root"][0]
        self.memory["started"] = 1.0
        self.root[:] = np.eye(N)
        self.filtered, self.forecasts = [], []

    def begin(self):
        self.memory["event"] = BEGAN
        self._remember()

    def step(self, measured):
        memory, mean, root = self.memory[0], self.mean, self.root
        memory["backup_mean"], memory["backup_root"] = mean, root
        memory["noise"] = self.noise
        cdkf.spread(mean, root, cdkf.STEP, N, LANES, self.points)
        points = self.points.reshape(N, LANES)
        points[:] = self.transition @ points
        work = memory["work"]
        cdkf.compress(self.points, self.noise, cdkf.STEP, N, LANES, mean, root, work)
        memory["forecast_mean"], memory["forecast_root"] = mean, np.tril(root)
        picks = np.array([0, 1])
        innovation, seen_root, gain = np.zeros(2), np.zeros((2, 2)), np.zeros((N, 2))
        std = np.concatenate((self.sensor, np.zeros(N - 2)))
        cdkf.innovate(mean, root, picks, 2, measured, std, innovation, seen_root, work)
        cdkf.correct(mean, root, N, picks, 2, std, innovation, seen_root, gain, work)
        self.memory["event"] = STEPPED
        forecast = memory["forecast_mean"].copy()
        self.forecasts.append((forecast, self._covariance(memory["forecast_root"])))
        self._remember()

    def _covariance(self, root):
        return np.tril(root) @ np.tril(root).T

    def _remember(self):
        self.filtered.append((self.mean.copy(), self._covariance(self.root)))
        notes = np.zeros(CYCLE_DATA_COUNT)
        store(self.ring, self.memory, self.points, notes, self.work)

    def at(self, lag):
        out = np.zeros(SMOOTH_SIZE)
        assert smoothed(SETUP, self.ring, lag, out, self.work)
        covariance = np.zeros((N, N))
        low = np.tril_indices(N)
        covariance[low] = covariance.T[low] = out[SMOOTH_COVARIANCE:SMOOTH_NET]
        return out[:SMOOTH_STD], covariance

    def textbook(self):
        """Rauch-Tung-Striebel over everything remembered, in plain numpy."""
        smooth = [self.filtered[-1]]
        for (mean, covariance), (ahead, spread) in zip(
            self.filtered[-2::-1], self.forecasts[::-1], strict=True
        ):
            gain = covariance @ self.transition.T @ np.linalg.inv(spread)
            after, certain = smooth[0]
            smooth.insert(
                0, (mean + gain @ (after - ahead), covariance + gain @ (certain - spread) @ gain.T)
            )
        return smooth


def run_linear(seed, steps, **more):
    one = Linear(seed, **more)
    one.begin()
    for _ in range(steps):
        one.step(one.random.normal(size=2))
    return one


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("steps", [1, 7, LAG])
def test_on_a_linear_system_it_is_the_textbooks_recursion(seed, steps):
    one = run_linear(seed, steps)

    for lag, (mean, covariance) in enumerate(one.textbook()[::-1]):
        found, certain = one.at(lag)
        scale = np.abs(covariance).max()
        assert np.allclose(found, mean, atol=1e-9 * (1.0 + np.abs(mean).max()))
        assert np.allclose(certain, covariance, atol=1e-9 * scale)


def test_without_process_noise_it_is_the_least_squares_solution():
    """Prior and all measurements at once, solved for the first state."""
    one = Linear(3, process=1e-9)
    one.begin()
    measurements = [one.random.normal(size=2) for _ in range(LAG)]
    for measured in measurements:
        one.step(measured)
    rows, wanted, observe = [np.eye(N)], [np.zeros(N)], np.eye(2, N)
    power = np.eye(N)
    for measured in measurements:
        power = one.transition @ power
        rows.append(observe @ power / one.sensor[:, None])
        wanted.append(measured / one.sensor)
    solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(wanted), rcond=None)[0]

    assert one.at(LAG)[0] == pytest.approx(solution, abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_what_comes_after_never_makes_it_less_sure(seed):
    one = run_linear(seed, LAG)

    for lag in range(1, LAG + 1):
        _, certain = one.at(lag)
        loss = one.filtered[-1 - lag][1] - certain
        assert np.linalg.eigvalsh(loss).min() >= -1e-12 * np.abs(certain).max()
        assert np.linalg.eigvalsh(certain).min() > 0.0


def test_older_than_the_lag_or_than_the_start_there_is_nothing():
    one = run_linear(1, 4)

    assert not smoothed(SETUP, one.ring, 5, np.zeros(SMOOTH_SIZE), one.work)
    assert not smoothed(SETUP, one.ring, LAG + 1, np.zeros(SMOOTH_SIZE), one.work)


def test_nothing_of_after_a_new_start_goes_to_before():
    one = run_linear(2, 5)
    before = [one.at(lag) for lag in range(3)]
    one.mean[:] = 50.0
    one.begin()
    one.step(one.random.normal(size=2))

    for lag, (mean, covariance) in enumerate(before):
        found, certain = one.at(lag + 2)
        assert np.array_equal(found, mean)
        assert np.array_equal(certain, covariance)


def test_a_cycle_in_which_nothing_happened_is_the_one_beside_it():
    one = run_linear(4, 5)
    one.memory["event"] = NOTHING
    one._remember()
    one.step(one.random.normal(size=2))

    assert np.array_equal(one.at(1)[0], one.at(2)[0])


# --- on the leg ----------------------------------------------------------------------------------


def walking(cadence_hz=0.5, lugre=False):
    cycles = int(3 / cadence_hz * 100) + 300
    path = gait(PATIENT, np.maximum(np.arange(1, cycles + 1) * 0.01 - 2.0, 0.0), cadence_hz)

    def patient(t):
        turns = 2 * np.pi * cadence_hz * t
        efforts = np.column_stack((8.0 * np.sin(turns), 40.0 * np.sin(turns + 1.0)))
        return efforts * (t > 2.0)[:, None]

    return simulate(PATIENT, cycles, reference=path, start=path[0], patient=patient, lugre=lugre)


@pytest.fixture(scope="module")
def walked():
    truth = walking()
    return truth, batch.run(SETUP, encoded(truth)), run_smoothed(SETUP, encoded(truth))


def errors(truth, estimates):
    rows = slice(300, None)
    open_gate = moving(truth)[rows]
    error = (estimates.state - truth.state)[rows, 6:8]
    return np.array([rms(error[open_gate[:, axis], axis]) for axis in range(2)])


def test_the_patient_is_known_several_times_better_150_ms_later(walked):
    truth, filtered, smooth = walked

    assert np.all(errors(truth, smooth) <= errors(truth, filtered) / 2.0)
    assert np.all(errors(truth, smooth) <= (0.16, 1.2))


def test_its_sigma_is_smaller_and_still_honest(walked):
    truth, filtered, smooth = walked
    rows = slice(300, -LAG)
    open_gate = moving(truth)[rows].all(axis=1)

    assert np.all(smooth.std[rows][open_gate, 6:] <= filtered.std[rows][open_gate, 6:] * 1.001)
    within = np.abs(smooth.state - truth.state)[rows, 6:8] <= 3 * smooth.std[rows, 6:8]
    assert np.mean(within[open_gate]) > 0.97


def test_what_is_no_estimate_of_the_past_stays_that_of_the_filter(walked):
    _, filtered, smooth = walked

    assert np.array_equal(filtered.status, smooth.status)
    assert np.array_equal(filtered.validity, smooth.validity)
    assert np.array_equal(filtered.nis, smooth.nis, equal_nan=True)


def test_the_newest_row_is_the_filters(walked):
    _, filtered, smooth = walked

    assert np.array_equal(filtered.state[-1], smooth.state[-1])


def test_live_and_offline_give_the_same_bits():
    recorded = encoded(walking())
    smooth = run_smoothed(SETUP, recorded)
    observer = LegObserver(PATIENT, HIP, SLIDE_FRICTION, SHIPPED)
    smoother = LegSmoother(observer)
    steps_s = np.rint(np.diff(recorded.time_s, prepend=recorded.time_s[:1]) * 1e9) * 1e-9
    steps_s[0] = 0.01
    found = []
    for position, effort, dt_s in zip(recorded.position, recorded.effort, steps_s, strict=True):
        estimate = observer.step(position, effort, dt_s)
        found.append(smoother.add(estimate, effort, dt_s))

    assert found[:LAG] == [None] * LAG
    live = np.array(found[LAG:])
    assert np.array_equal(live[:, :N], smooth.state[:-LAG])
    assert np.array_equal(live[:, SMOOTH_STD:SMOOTH_COVARIANCE], smooth.std[:-LAG])


@pytest.mark.parametrize(
    ("estimates_of", "of"), [(batch.run, "batch"), (run_smoothed, "smooth_batch")]
)
def test_a_repeat_gives_the_same_bits_whatever_the_blocks(monkeypatch, estimates_of, of):
    recorded = encoded(walking())
    whole = estimates_of(SETUP, recorded)
    monkeypatch.setattr(f"observer.offline.{of}.BLOCK_ROWS", 77)
    told: list[float] = []

    parts = estimates_of(SETUP, recorded, told.append)

    assert parts.state.tobytes() == whole.state.tobytes()
    assert parts.std.tobytes() == whole.std.tobytes()
    assert told[-1] == 1.0


def test_rough_recordings_leave_every_number_a_number():
    from tests.observer.test_extremes import rough

    smooth = run_smoothed(SETUP, rough(PATIENT, 20_000, 9))

    begun = int(np.argmax(np.isfinite(smooth.state[:, 0])))
    for values in (smooth.state, smooth.std, smooth.covariance, smooth.net_std):
        assert np.isfinite(values[begun:]).all()
    assert (smooth.std[begun:] > 0.0).all()


@pytest.mark.parametrize("rows", [0, 1, 5, LAG, LAG + 1])
def test_short_recordings_are_smoothed_with_what_there_is(rows):
    recorded = encoded(walking())
    few = Columns(recorded.time_s[:rows], recorded.position[:rows], recorded.effort[:rows])

    smooth = run_smoothed(SETUP, few)

    assert smooth.state.shape == (rows, N)
    assert np.isfinite(smooth.state).all()


def test_before_the_first_pose_there_is_no_number():
    recorded = encoded(walking())
    position = recorded.position[:60].copy()
    position[:30] = math.nan
    smooth = run_smoothed(SETUP, Columns(recorded.time_s[:60], position, recorded.effort[:60]))

    assert np.isnan(smooth.state[:30]).all()
    assert np.isfinite(smooth.state[30:]).all()
