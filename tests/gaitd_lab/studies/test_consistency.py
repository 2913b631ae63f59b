"""The measures of consistency, on the shipped robot, and on robots that are lied about."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import gaitd
from gaitd_toml import load_toml

from analysis.replay_report import drift_of
from daemon.config.settings import Robot
from gaitd_lab.studies.consistency import measures as consistency
from gaitd_lab.studies.consistency import study
from gaitd_lab.studies.consistency.measures import (
    drifting,
    gaps,
    monte_carlo,
    offsets,
    plant_of,
    still,
)
from observer.drift import NO_DRIFT
from observer.filter.leg_model import STEP_S
from observer.filter.status import Status, Validity

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture(scope="module", params=["robot_empty.toml", "robot.toml"])
def plant(request):
    return plant_of(load_toml(CONFIGS / request.param, Robot))


@pytest.fixture(scope="module")
def empty():
    return plant_of(load_toml(CONFIGS / "robot_empty.toml", Robot))


def test_nees_and_nis_are_in_their_bands_and_innovations_white(plant):
    found = monte_carlo(plant, runs=40, steps=300)

    assert found.nees.inside, found.nees
    assert found.nees.inside_ratio >= 0.75
    assert found.nis.inside_ratio >= 0.88
    assert found.nis.inside, found.nis
    assert abs(found.correlation) < 0.05
    assert np.all(found.within_ratio[2] >= 0.99)
    assert np.all(np.abs(found.within_ratio[0] - 0.683) <= 0.08)


def test_a_filter_that_believes_in_too_little_noise_is_found_out(empty):
    proud = empty.tuning._replace(
        process_std=tuple(0.3 * std for std in empty.tuning.process_std),
        patient_noise_max_ratio=1.0,
    )
    random_plant = empty  # whose noise is the honest one

    def noisy_run(plant, random, steps):
        truth, _ = honest(random_plant, random, steps)
        efforts = consistency.moving_efforts(random_plant, steps)
        noise = random.normal(size=(steps, 2)) * random_plant.tuning.measurement_std
        return truth, consistency.observed(plant, truth[:, :2] + noise, efforts)

    honest = consistency._noisy_run
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(consistency, "_noisy_run", noisy_run)
        found = monte_carlo(empty._replace(tuning=proud), runs=20, steps=300)

    assert not found.nees.inside
    assert found.nees.mean > found.nees.high


def test_at_rest_the_split_stays_open_and_the_net_does_not(plant):
    rest = still(plant)
    std, net = rest.estimates.std, rest.estimates.net_std

    assert rest.patient_rms[0] <= 0.1
    assert rest.patient_rms[1] <= 1.0
    for axis, law in enumerate(plant.frictions):
        assert std[-1, 6 + axis] >= 0.35 * law.stribeck
        assert net[-1, axis] <= 0.1 * law.stribeck
        assert std[-1, 6 + axis] >= 0.99 * std[500, 6 + axis]


def test_in_a_gap_sigma_grows_and_holds_the_error(plant):
    for gap in gaps(plant):
        assert max(gap.sigmas) <= 3.0
        assert min(gap.growth) >= 2.0


def test_drift_is_found_in_sign_and_size(empty):
    for one in drifting(empty, (0.9, 1.0, 1.1)):
        for axis in range(2):
            assert one.friction_error[axis] == pytest.approx(
                one.true_error[axis], abs=0.01 * empty.frictions[axis].coulomb
            )


def test_nothing_wild_is_shown_after_the_workspace_was_left(empty):
    """Friction 20 % lower than in the file lets each of these reach the straight leg."""
    lower = tuple(
        one._replace(stribeck=0.8 * one.stribeck, coulomb=0.8 * one.coulomb)
        for one in empty.frictions
    )
    efforts = consistency.moving_efforts(empty, 360)

    for seed in range(1, 13):
        _, position = consistency._clean(empty._replace(frictions=lower), efforts, seed)
        found = consistency.observed(empty, position, efforts)
        assert np.any(found.status & Status.OUT_OF_WORKSPACE)
        for axis, most in ((0, 3.0), (1, 40.0)):
            shown = found.validity[:, axis] == Validity.OK
            assert np.abs(found.state[shown, 6 + axis]).max() < most, seed


def test_an_artificial_disturbance_is_no_drift(empty):
    efforts = consistency.moving_efforts(empty, 2500)
    _, position = consistency._clean(empty, efforts)
    estimates = consistency.observed(empty, position, efforts)
    told = drift_of(estimates, empty.frictions, STEP_S)
    estimates.status[:] |= int(Status.ARTIFICIAL)

    assert all(one.motion_s > 1.0 for one in told)
    assert drift_of(estimates, empty.frictions, STEP_S) == [NO_DRIFT, NO_DRIFT]


def test_a_lasting_offset_is_believed_after_five_cycles_and_flagged(plant):
    for one in offsets(plant):
        assert one.believed_after_cycles == 5
        assert one.flagged
        assert one.valid_after_cycles <= 30


def test_the_same_seeds_give_the_same_numbers(empty):
    one, other = (monte_carlo(empty, runs=3, steps=150) for _ in range(2))

    assert one.nees == other.nees
    assert np.array_equal(one.within_ratio, other.within_ratio)


def test_the_command_prints_and_writes_what_it_measured_and_ends_with_0(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "LEVEL_RATIOS", (0.9, 1.0))
    ran = gaitd("consistency", "--runs", 12, "--seeds", 1, "--output", tmp_path, "--json")

    assert ran.code == 0, ran.out + ran.err
    assert json.loads(ran.out)["passed"] is True
    page = (tmp_path / "consistency.md").read_text("utf-8")
    for word in (
        "NEES",
        "NIS",
        "an innovation",
        "3 sigma",
        "at rest",
        "Gaps",
        "Friction",
        "offset",
    ):
        assert word in ran.err
        assert word in page
    assert "OUTSIDE" not in ran.err
    assert (tmp_path / "consistency_runs.png").stat().st_size > 10_000
