"""Whatever the file says at first, a calibration ends at the same values, or says that it cannot.

The simulated axis sets the trap of a recorded one: a short range, over which a spring that is not
there can take the place of friction; a constant force; an encoder a hundred times better than the
file says. In `make test` `tests/gaitd_lab/studies/test_real_data.py` calibrates it as a whole, with
one search. The recorded axis itself is tested with `--recordings=FOLDER`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from empty_runs import ROBOT_FILE, empty_run, shipped_friction, write_csv
from gaitd_toml import load_toml
from one_axis import (
    CONSTANT_N,
    COULOMB_N,
    MASS_KG,
    VISCOUS_N_S_PER_M,
    one_axis_file,
    one_axis_run,
)
from scipy.stats import chi2, kstest
from typer.testing import CliRunner

from analysis.calibration import fit, session
from analysis.calibration.advice import advice
from analysis.calibration.likelihood import Surprises
from analysis.calibration.motion import prepare
from analysis.calibration.page import tables
from analysis.calibration.process_noise import process_noise, with_process_noise
from analysis.calibration.quantities import OFFSETS, SLOPE_SCALE, SLOPES, frame_of
from analysis.calibration.session import Calibration, calibrate, middle_of
from analysis.recording import RecordingError
from analysis.replay import Source, estimate, read
from daemon.config.edits import replaced
from daemon.config.settings import Robot
from gaitd.__main__ import build
from gaitd.command_line import CommandError
from gaitd.terminal import plain

SAME_PER_SAMPLE = 0.01
RECORDED_FALSE_MAX_N = 1.7
RECORDED_CONSTANT_N = -3.17
ENCODERS_M = (2.5e-5, 5e-6)
SETTLED_ROWS = 50


@pytest.fixture(scope="module")
def run() -> Source:
    return one_axis_run()


@pytest.fixture(scope="module")
def short() -> Source:
    """For tests whose searches stay where they begin."""
    return one_axis_run(12.0)


@pytest.fixture(scope="module")
def made(run) -> Calibration:
    return calibrate([run], one_axis_file(coulomb_n=14.0, viscous_n_s_per_m=260.0, mass_kg=95.0))


def found(made: Calibration, label: str) -> float:
    return next(one.value for one in made.fit.results if one.quantity.label == label)


def assert_true(made: Calibration) -> None:
    assert not made.refused
    assert found(made, "slide coulomb") == pytest.approx(COULOMB_N, rel=0.03)
    assert found(made, "slide viscous") == pytest.approx(VISCOUS_N_S_PER_M, rel=0.03)
    assert found(made, "slide drive mass") == pytest.approx(MASS_KG, rel=0.01)


@pytest.mark.thorough
def test_friction_mass_and_a_constant_force_of_a_short_axis_are_found(made):
    assert_true(made)
    offset = made.fit.results[OFFSETS[1]]
    assert offset.value == pytest.approx(CONSTANT_N, abs=min(offset.half_interval, 0.2))
    assert made.robot.effort_offset.slide.force_n == offset.value
    assert made.values("x")[offset.quantity.key][0] == offset.value
    assert made.after.slide_rms_n < 0.2 * made.before.slide_rms_n


@pytest.mark.thorough
def test_a_machine_without_a_spring_gets_none_and_hears_of_none(made):
    said = [
        plain(tables(made)[0]),
        str(made.check),
        made.refused,
        *advice(made.motion, made.fit.results),
    ]

    assert "spring" not in " ".join(said)
    assert made.robot.springs == one_axis_file(coulomb_n=1, viscous_n_s_per_m=1, mass_kg=1).springs
    assert not [key for key in made.values("x") if key.startswith("springs")]


@pytest.mark.thorough
def test_calibrated_process_noise_gives_nis_its_distribution_on_another_recording(made):
    """Before it the observer expected ten times more than happens, as on a recorded axis."""
    other = one_axis_run(seed=2)
    noise = process_noise(made.robot, made.motion, made.fit.natural)

    def nis(robot: Robot) -> np.ndarray:
        return estimate(other, robot).nis[SETTLED_ROWS:]

    assert np.mean(nis(made.robot)) < 0.2
    calibrated = nis(with_process_noise(made.robot, noise))
    assert np.mean(calibrated) == pytest.approx(1.0, abs=0.1)
    assert kstest(calibrated, chi2(1).cdf).statistic < 0.05


@pytest.mark.thorough
@pytest.mark.parametrize(
    "start",
    [
        {"coulomb_n": 30.0, "viscous_n_s_per_m": 120.0, "mass_kg": 80.0},
        {"coulomb_n": 20.5, "viscous_n_s_per_m": 203.0, "mass_kg": 95.0, "encoder_m": 5e-6},
        {"coulomb_n": 24.5, "viscous_n_s_per_m": 165.0, "mass_kg": 85.0},
        {"coulomb_n": 24.5, "viscous_n_s_per_m": 165.0, "mass_kg": 95.0, "encoder_m": 5e-8},
    ],
)
def test_every_start_ends_at_the_same_optimum(run, made, start):
    other = calibrate([run], one_axis_file(**start))

    assert_true(other)
    assert other.fit.loss_per_sample == pytest.approx(made.fit.loss_per_sample, abs=SAME_PER_SAMPLE)


def test_two_optima_that_explain_a_recording_equally_well_are_refused(short, tmp_path, monkeypatch):
    """Searches that stay where they begin, as if that were an optimum; one with other friction."""
    begun = []

    def stays(search, x, steps_max):
        free = search.whole(x)
        begun.append(free)
        if len(begun) == len(fit.START_ENCODERS) + 2:
            free[fit.LAW_SIZE] += np.log(1.4)
        return fit._End(free, 0.0, 1)

    monkeypatch.setattr(fit, "_walk", stays)
    monkeypatch.setattr(fit, "_unidentified", lambda *_: {})
    monkeypatch.setattr(fit, "START_LAWS", ((1.0, 1.0, 1.0, 1.0),))
    monkeypatch.setattr(session, "CANDIDATES", ())
    monkeypatch.setattr(session, "softness", lambda *_: {})
    monkeypatch.setattr(session, "no_better_than_eq_11", lambda *_: "bristles are not meant here")
    monkeypatch.setattr(session, "like_fitted", lambda frame, *_: frame.natural)
    monkeypatch.setattr(fit, "robust_covariance", lambda _each, fisher, _rows: 0.0 * fisher)
    recorded = write_csv(short, tmp_path / "run.csv")
    robot = tmp_path / "robot.toml"
    text = ROBOT_FILE.read_text()
    for given in ("hip.stiffness_nm_per_rad = 20.0", "slide.stiffness_n_per_m = 120.0"):
        assert given in text
        text = text.replace(given, f"{given.split(' =')[0]} = 0.0")
    robot.write_text(text)

    ran = CliRunner().invoke(
        build("calibrate"), ["calibrate", str(recorded), "--robot", str(robot)]
    )

    why = str(ran.exception)
    assert isinstance(ran.exception, CommandError), ran.output
    assert why.startswith("nothing written: ")
    assert "two sets of values explain this recording equally well" in why
    assert "slide coulomb" in why
    assert not list(tmp_path.glob("*.robot.toml"))


def test_a_second_optimum_is_none_where_its_search_cannot_begin(short, monkeypatch):
    robot = one_axis_file(coulomb_n=14.0, viscous_n_s_per_m=260.0, mass_kg=95.0)
    motion = prepare([short.recording])
    begun = []

    def stays(search, x, steps_max):
        begun.append(search.whole(x))
        if len(begun) == len(fit.START_ENCODERS) + 2:
            begun[-1][fit.LAW_SIZE] += np.log(1.4)
        return fit._End(begun[-1], 0.0, 1)

    monkeypatch.setattr(fit, "_walk", stays)
    monkeypatch.setattr(fit, "best_start", lambda _, free, motion: free)
    monkeypatch.setattr(fit, "_unidentified", lambda *_: {})
    monkeypatch.setattr(fit, "robust_covariance", lambda _each, fisher, _rows: 0.0 * fisher)
    made = fit.fit(frame_of(robot, middle_of(motion)), motion, lambda *_: None)
    assert "slide coulomb" in made.rival()

    monkeypatch.setattr(
        fit, "_walk", lambda search, x, steps_max: fit._End(search.whole(x), np.inf, 0, "no slope")
    )
    assert made.rival() == ""


def test_searches_begin_with_the_best_noise_and_the_best_of_them_counts(short, monkeypatch):
    """Searches that stay where they begin, but for the encoder's and the effort's noise."""
    robot = one_axis_file(coulomb_n=14.0, viscous_n_s_per_m=260.0, mass_kg=95.0)
    motion = prepare([short.recording])
    count = len(fit.START_ENCODERS)
    losses = iter((*range(count, 0, -1), 5.0, 3.0, 4.0))
    begun, ends = [], []

    def stays(search, x, steps_max):
        begun.append(search.whole(x))
        ends.append(search.whole(x))
        if len(begun) <= count:
            ends[-1][fit.NOISE : fit.TIMING] += 0.1 * len(begun)
        return fit._End(ends[-1].copy(), next(losses, 0.0), 1)

    monkeypatch.setattr(fit, "_walk", stays)
    monkeypatch.setattr(fit, "best_start", lambda _, free, motion: free)
    monkeypatch.setattr(fit, "_identified", lambda _, end, *__: (end, np.zeros(2 * [fit.SIZE])))
    fit.fit(frame_of(robot, middle_of(motion)), motion, lambda *_: None)

    encoder, effort = slice(fit.NOISE, fit.NOISE + 2), slice(fit.NOISE + 2, fit.TIMING)
    searches, best_noise = begun[count : count + 3], ends[count - 1]
    assert all(np.array_equal(one[encoder], best_noise[encoder]) for one in searches)
    takes_effort = [np.array_equal(one[effort], best_noise[effort]) for one in searches]
    assert takes_effort == [False, False, True]
    assert searches[1][1 + fit.LAW_SIZE] > searches[0][1 + fit.LAW_SIZE], "a larger hump"
    assert np.array_equal(begun[count + 3], searches[1]), "the fine search goes on from the best"


def test_a_quantity_that_is_kept_has_the_file_s_value_in_every_search(short, monkeypatch):
    robot = one_axis_file(coulomb_n=14.0, viscous_n_s_per_m=260.0, mass_kg=95.0)
    robot = replaced(robot, {"friction_over_position.slide.slope_per_m": 0.1})
    motion = prepare([short.recording])
    searched = []

    def stays(search, x, steps_max):
        searched.append(search.whole(x)[SLOPES[1]] * SLOPE_SCALE)
        return fit._End(search.whole(x), 0.0, 1)

    monkeypatch.setattr(fit, "_walk", stays)
    monkeypatch.setattr(fit, "best_start", lambda _, free, motion: free)

    def searches(near=None, kept=()):
        searched.clear()
        made = fit.fit(
            frame_of(robot, middle_of(motion)),
            motion,
            lambda *_: None,
            near,
            dict.fromkeys(kept, "x"),
        )
        return made, set(np.round(searched, 9))

    free, begun = searches()
    assert 0.1 not in begun
    assert [one.exists for one in free.results if one.quantity.key.startswith("springs")] == 4 * [
        False
    ]
    assert searches(kept=[SLOPES[1]])[1] == {0.1}
    assert searches(free, [SLOPES[1]])[1] == {0.1}


def test_a_file_with_which_no_motion_can_be_computed_is_refused_with_what_to_do():
    robot = replaced(load_toml(ROBOT_FILE, Robot), {"geometry.thigh_length_m": 0.25})

    with pytest.raises(RecordingError, match="the robot file does not fit the recording"):
        calibrate([empty_run(shipped_friction(), duration_s=12.0)], robot)


class Steep:
    """A likelihood whose slope is lost beyond a value, or wherever the search begins."""

    def __init__(self, frame, motion, lost_from):
        self.frame, self.motion, self.lost_from = frame, motion, lost_from
        self.row = np.arange(20)
        self.begun = None

    def surprises(self, free):
        self.begun = free[0] if self.begun is None else self.begun
        lost = np.nan if free[0] - self.begun > self.lost_from else 0.0
        return Surprises(np.full(20, 9.0 - 3.0 * (free[0] - self.begun)) + lost, np.ones(20))

    def derivatives(self, free, which):
        base = self.surprises(free)
        dz = np.zeros((20, len(which)))
        dz[:, 0] = (-3.0 if free[0] - self.begun <= 0.0 else np.inf) + 0.0 * base.z
        return base, dz, np.zeros((20, len(which)))


def test_a_search_ends_where_the_likelihood_has_no_slope_any_more():
    robot = load_toml(ROBOT_FILE, Robot)
    motion = prepare([empty_run(shipped_friction(), duration_s=10.0).recording])
    frame = frame_of(robot, middle_of(motion))
    free, which = frame.free(frame.natural), np.arange(2)

    def searched(lost_from):
        likelihood = Steep(frame, motion, lost_from)
        likelihood.surprises(free)
        return fit._walk(
            fit._Search(likelihood, free, free.copy(), which, lambda *_: None, ()), free[which], 9
        )

    ended, never_begun = searched(9.0), searched(-1.0)

    assert (ended.why, ended.step_count) == ("", 1)
    assert np.array_equal(ended.free, free)
    assert ended.begun() is ended
    assert never_begun.loss == np.inf
    with pytest.raises(
        RecordingError, match=r"at 0\.01 s, hip .* the leg of the robot file cannot"
    ):
        never_begun.begun()


def emps(config) -> Path | None:
    folder = config.getoption("recordings")
    return folder and folder / "emps"


def pytest_generate_tests(metafunc):
    if "recorded_start" not in metafunc.fixturenames:
        return
    folder = emps(metafunc.config)
    names = sorted((*folder.glob("robot_*.toml"), *folder.glob("starts/*.toml"))) if folder else []
    params = [
        pytest.param((name, encoder_m), id=f"{name.stem}-{1e6 * encoder_m:g}um")
        for name in names
        for encoder_m in ENCODERS_M
    ]
    skip = pytest.mark.skip(reason="needs --recordings=FOLDER")
    metafunc.parametrize("recorded_start", params or [pytest.param(None, marks=skip)])


def recorded_file(name, encoder_m: float) -> Robot:
    robot = load_toml(name, Robot)
    return replaced(robot, {"observer.slide.measurement_position_m": encoder_m})


@pytest.fixture(scope="module")
def recorded(request) -> Calibration:
    folder = emps(request.config)
    if folder is None:
        pytest.skip("needs --recordings=FOLDER")
    return calibrate([read(folder / "clean.csv")], load_toml(folder / "robot_emps.toml", Robot))


def test_every_start_on_a_recorded_axis_ends_at_the_same_optimum(recorded_start, recorded, request):
    folder = emps(request.config)
    other = calibrate([read(folder / "clean.csv")], recorded_file(*recorded_start))

    assert not other.refused
    assert other.check.mendable
    assert other.after.slide_rms_n <= RECORDED_FALSE_MAX_N
    assert other.fit.loss_per_sample == pytest.approx(
        recorded.fit.loss_per_sample, abs=SAME_PER_SAMPLE
    )
    assert "spring" not in " ".join((plain(tables(other)[0]), str(other.check)))


def test_the_constant_force_of_a_recorded_axis_is_no_false_effort(recorded, request):
    folder = emps(request.config)
    source = read(folder / "clean.csv")
    effort = source.recording.effort + np.array((0.0, RECORDED_CONSTANT_N))
    shifted = source._replace(recording=replace(source.recording, effort=effort))

    other = calibrate([shifted], load_toml(folder / "robot_emps.toml", Robot))

    change = found(other, "slide effort offset") - found(recorded, "slide effort offset")
    assert change == pytest.approx(RECORDED_CONSTANT_N, abs=0.1)
    assert other.after.slide_rms_n <= RECORDED_FALSE_MAX_N
