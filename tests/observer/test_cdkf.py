"""Appendix A against what is known of it: the linear Kalman filter, moments, signs, and mutants."""

import importlib.util
import itertools
from pathlib import Path
from types import FunctionType

import numpy as np
import pytest

from observer.filter import cdkf
from observer.jit import kernel
from tests.observer import general_filter

STEPS = 100


def linear_model(state, inputs, dt_s):
    return inputs.reshape((state.size, state.size)) @ state


def linear_measurement(state, inputs):
    return inputs.reshape((inputs.size // state.size, state.size)) @ state


class LinearSystem:
    """Random F, H, Q, R and a run of measurements."""

    def __init__(self, seed: int, n: int = 6, m: int = 2, steps: int = STEPS):
        random = np.random.default_rng(seed)
        turn, _ = np.linalg.qr(random.normal(size=(n, n)))
        self.F = turn @ np.diag(random.uniform(0.7, 1.0, n)) @ turn.T
        self.H = random.normal(size=(m, n))
        self.q = random.uniform(0.1, 1.0, n)
        self.r = random.uniform(0.1, 1.0, m)
        self.start = random.normal(size=n)
        self.root = np.linalg.cholesky(np.eye(n) + 0.3 * np.ones((n, n)))
        self.measured = random.normal(size=(steps, m))

    def joseph(self):
        """The linear Kalman filter in Joseph form: mean, covariance, NIS after each step."""
        x, P = self.start, self.root @ self.root.T
        Q, R, identity = np.diag(self.q**2), np.diag(self.r**2), np.eye(len(x))
        for z in self.measured:
            x, P = self.F @ x, self.F @ P @ self.F.T + Q
            S = self.H @ P @ self.H.T + R
            innovation = z - self.H @ x
            K = np.linalg.solve(S, self.H @ P).T
            left = identity - K @ self.H
            x, P = x + K @ innovation, left @ P @ left.T + K @ R @ K.T
            yield x, P, innovation @ np.linalg.solve(S, innovation)


def filtered(system, predict, update, root=None):
    x = system.start.copy()
    S = (system.root if root is None else root).copy()
    for z in system.measured:
        predict(x, S, system.F.ravel(), 0.01, system.q, cdkf.STEP)
        nis = update(x, S, system.H.ravel(), z, system.r, cdkf.STEP)
        yield x.copy(), S.copy(), nis


def worst_difference(system, predict, update):
    """Errors of means (absolute), covariances (relative) and NIS (relative)."""
    worst = np.zeros(3)
    for (x, P, nis), (mean, S, ours) in zip(
        system.joseph(), filtered(system, predict, update), strict=True
    ):
        differences = (
            np.abs(mean - x).max(),
            np.abs(S @ S.T - P).max() / np.abs(P).max(),
            abs(ours - nis) / max(1.0, nis),
        )
        worst = np.maximum(worst, np.nan_to_num(differences, nan=np.inf))
    return worst


@pytest.mark.parametrize("seed", range(3))
def test_on_a_linear_system_it_is_the_kalman_filter(seed, plain):
    mean, covariance, nis = worst_difference(LinearSystem(seed), *filter_of(plain))

    assert mean <= 1e-12
    assert covariance <= 1e-13
    assert nis <= 1e-11


def plain_copy(folder: Path, name: str, *changes: tuple[str, str]):
    """The source of both modules in one, changed and not compiled."""
    rest = Path(general_filter.__file__).read_text().partition("# --- the filter")[2]
    source = f"{Path(cdkf.__file__).read_text()}\nimport numba\n# {rest}"
    plain = (
        (
            "from observer.jit import inline",
            "from collections.abc import Callable\n"
            "from typing import Any\ndef inline(function): return function",
        ),
        ('numba.njit(error_model="numpy")(function)', "function"),
    )
    for old, new in (*plain, *changes):
        assert source.count(old) == 1, old
        source = source.replace(old, new)
    file = folder / f"{name}.py"
    file.write_text(source)
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """What mutants are made of, unchanged: to compile it would take longer than to run it."""
    return plain_copy(tmp_path_factory.mktemp("plain"), "plain")


def filter_of(module):
    return module.time_update(linear_model), module.measurement_update(linear_measurement)


KEEP_POINTS = (
    "        compress(points, np.diag(noise_std), step, n, lanes, mean, root, np.empty(3 * n * n))",
    "        predict.points = points\n"
    "        compress(points, np.diag(noise_std), step, n, lanes, mean, root, np.empty(3 * n * n))",
)
REUSE_POINTS = (
    "        seen = np.empty((m, lanes))",
    "        points = KEPT.points\n        seen = np.empty((m, lanes))",
)
SUBTRACT = "            for j in range({}):\n                work[row * columns + k] -= gain"
LEAVE_OUT_NOISE = (SUBTRACT.format("m"), SUBTRACT.format("m if k < 2 * n else 0"))
MUTANTS = {
    "columns of the upper factor": (
        [("step * root[row, column]", "step * root[column, row]")],
        0.1,
    ),
    "K sqrt(R) left out": ([LEAVE_OUT_NOISE], 1e-3),
    "sigma points used again": ([KEEP_POINTS, REUSE_POINTS], 1e-2),
}


def mutant_difference(tmp_path, changes):
    module = plain_copy(tmp_path, "mutant", *changes)
    predict, update = filter_of(module)
    module.KEPT = predict
    with np.errstate(all="ignore"):
        return worst_difference(LinearSystem(0, n=4, steps=25), predict, update).max()


@pytest.mark.parametrize("name", MUTANTS)
def test_a_mutant_is_not_the_kalman_filter(tmp_path, name):
    changes, at_least = MUTANTS[name]

    assert mutant_difference(tmp_path, changes) > at_least


def by_states(cdkf, mean, root, picks, measured, noise_std):
    n, count = mean.size, picks.size
    innovation, innovation_root = np.zeros(count), np.zeros((count, count))
    gain, work = np.zeros((n, count)), np.zeros(n * (n + count))
    nis = cdkf.innovate(
        mean, root, picks, count, measured, noise_std, innovation, innovation_root, work
    )
    cdkf.correct(mean, root, n, picks, count, noise_std, innovation, innovation_root, gain, work)
    return nis


@pytest.mark.parametrize(
    "picks", [p for size in (1, 2, 3) for p in itertools.combinations(range(5), size)]
)
def test_measuring_states_needs_no_sigma_points(picks, plain):
    random = np.random.default_rng(sum(picks))
    n = 5
    root = np.linalg.cholesky(np.cov(random.normal(size=(n, 40))))
    mean, measured = random.normal(size=n), random.normal(size=n)
    noise = random.uniform(0.1, 1.0, n)
    H = np.eye(n)[list(picks)]
    general_mean, general_root = mean.copy(), root.copy()

    nis = by_states(plain, mean, root, np.array(picks), measured, noise)
    _, update = filter_of(plain)
    general = update(general_mean, general_root, H.ravel(), H @ measured, H @ noise, cdkf.STEP)

    assert nis == pytest.approx(general, rel=1e-12)
    np.testing.assert_allclose(mean, general_mean, rtol=0, atol=1e-13)
    np.testing.assert_allclose(root, general_root, rtol=0, atol=1e-13)


def test_moments_of_a_square_are_exact_for_every_step(plain):
    """y = x^2 of x ~ N(m, s^2): mean m^2 + s^2, variance 4 m^2 s^2 + 2 s^4."""
    predict = plain.time_update(lambda state, inputs, dt_s: state * state)
    for step in (1.2, np.sqrt(3.0), 2.5):
        mean, root = np.array([0.7]), np.array([[0.4]])

        predict(mean, root, np.zeros(0), 0.01, np.zeros(1), step)

        assert mean[0] == pytest.approx(0.7**2 + 0.4**2, rel=1e-14)
        assert root[0, 0] ** 2 == pytest.approx(4 * 0.7**2 * 0.4**2 + 2 * 0.4**4, rel=1e-13)


def test_the_root_is_lower_triangular_with_a_diagonal_that_is_not_negative(plain):
    for _, S, _ in filtered(LinearSystem(3), *filter_of(plain)):
        assert np.all(np.triu(S, 1) == 0.0)
        assert np.all(np.diag(S) >= 0.0)


def test_signs_of_the_roots_columns_change_nothing(plain):
    system, whole = LinearSystem(4), filter_of(plain)
    signs = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, 1.0])

    for one, other in zip(
        filtered(system, *whole), filtered(system, *whole, system.root @ signs), strict=True
    ):
        np.testing.assert_allclose(other[0], one[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(other[1], one[1], rtol=0, atol=1e-12)


@kernel
def steps_that_stay_well(noises):
    """Steps with noise and glitches; the first step whose root is bad, or -1; smallest diagonal."""
    n, lanes = 4, 9
    mean, root = np.zeros(n), np.eye(n)
    points, work = np.zeros(n * lanes), np.zeros(3 * n * n)
    noise, sensor = np.diag(np.array([1e-6, 1e-3, 0.1, 10.0])), np.full(n, 1e-5)
    picks, innovation = np.array([0]), np.zeros(1)
    innovation_root, gain = np.zeros((1, 1)), np.zeros((n, 1))
    smallest = 1e300
    for k in range(noises.size):
        cdkf.spread(mean, root, cdkf.STEP, n, lanes, points)
        for j in range(lanes):
            for row in range(n - 1):
                points[row * lanes + j] += 0.01 * points[(row + 1) * lanes + j]
            points[(n - 1) * lanes + j] *= 0.9
        cdkf.compress(points, noise, cdkf.STEP, n, lanes, mean, root, work)
        measured = mean + noises[k] + (1.0 if k % 97 == 0 else 0.0)
        cdkf.innovate(mean, root, picks, 1, measured, sensor, innovation, innovation_root, work)
        cdkf.correct(mean, root, n, picks, 1, sensor, innovation, innovation_root, gain, work)
        for i in range(n):
            smallest = min(smallest, root[i, i])
            if not (root[i, i] > 0.0 and np.isfinite(mean[i]) and np.all(np.isfinite(root[i]))):
                return k, smallest
    return -1, smallest


def leaves_it_definite(steps, count):
    bad, smallest = steps(np.random.default_rng(5).normal(size=count) * 1e-5)

    assert bad == -1
    assert smallest > 1e-9


def test_steps_with_glitches_leave_the_covariance_definite(plain):
    """To compile them would take longer."""
    code = steps_that_stay_well.py_func.__code__
    leaves_it_definite(FunctionType(code, {"cdkf": plain, "np": np}), 2_000)


@pytest.mark.thorough
def test_a_million_compiled_steps_with_glitches_leave_the_covariance_definite():
    leaves_it_definite(steps_that_stay_well, 1_000_000)
