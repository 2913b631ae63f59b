"""The ablation: every choice on and off. `test_ablation_claims.py` has what the page claims."""

import json
import math

import numpy as np
import pytest
from command_line import gaitd

from analysis.ablation import (
    Errors,
    ablate,
    disturbed,
    errors_of,
    over_seeds,
    replayed,
    summary,
)
from analysis.ablation_choices import CHOICES, SHIPPED
from analysis.ablation_figures import three_digits
from analysis.ablation_page import write_page
from analysis.ablation_questions import QUESTIONS, WRONG
from daemon.config.robot import leg_parameters, observer_tuning
from gaitd_lab.ablation_trials import Planned
from observer.filter.leg_model import integrator_named

ACTIVE = "paper, 0.5 Hz, active"


@pytest.fixture(scope="module")
def results(walk) -> dict[tuple[str, str], Errors]:
    return ablate(walk)


def test_every_choice_is_replayed_with_finite_numbers(results):
    assert set(results) == {(ACTIVE, choice.name) for choice in CHOICES}
    for (_, choice), errors in results.items():
        shares = (*errors.net_covered, *errors.ok_share, errors.nis)
        errors_si = (*errors.net, *errors.velocity, *errors.patient, *errors.friction)
        assert np.isfinite([*shares, *errors_si]).all(), choice


def test_each_choice_but_the_first_changes_the_robot(walk):
    robot = walk.robot

    assert CHOICES[0].change(robot) == robot
    assert len({choice.name for choice in CHOICES}) == len(CHOICES)
    for choice in CHOICES[1:]:
        assert choice.change(robot) != robot, choice.name


def test_every_choice_is_asked_about_and_every_question_knows_its_choices():
    asked = {choice for question in (*QUESTIONS, *WRONG) for choice in question.choices}

    assert asked == {choice.name for choice in CHOICES}
    assert all(question.choices[0] == SHIPPED for question in (*QUESTIONS, *WRONG))


def test_explicit_euler_is_refused_and_not_compared():
    with pytest.raises(ValueError, match="unstable"):
        integrator_named("euler")


def test_rising_noise_follows_an_active_patient_and_covers_him_again(results):
    agile, slow = (results[ACTIVE, name] for name in (SHIPPED, "noise never rises"))

    assert agile.patient[0] < 0.8 * slow.patient[0]
    assert agile.patient_covered[0] > 0.98
    assert slow.patient_covered[0] < 0.9


def test_the_papers_tuning_takes_half_of_an_active_patient_for_friction(results):
    paper, shipped = results[ACTIVE, "paper's noise"], results[ACTIVE, SHIPPED]

    assert paper.patient[0] > 3 * shipped.patient[0]
    assert paper.friction[0] > 3 * shipped.friction[0]


def test_the_choices_reach_the_observer(walk):
    robot = walk.robot
    tunings = {choice.name: observer_tuning(choice.change(robot)) for choice in CHOICES}
    legs = {choice.name: leg_parameters(choice.change(robot)) for choice in CHOICES}

    assert not tunings["without Coriolis"].coriolis
    assert tunings["delay configured"].effort_delay_ms == 10.0
    assert legs["leg set 10 % heavy"].shank_inertia > legs[SHIPPED].shank_inertia
    paper = tunings["paper's observer"]
    assert paper.process_std[4] == pytest.approx(10 * paper.process_std[6])


def test_errors_are_zero_and_all_is_covered_where_the_estimate_is_the_truth(walk):
    made = replayed(walk, CHOICES[0])
    made.state[:] = walk.truth
    made.net[:] = walk.truth[:, 6:8] - walk.truth[:, 4:6]

    errors = errors_of(walk, made)

    assert errors.patient == errors.friction == errors.net == errors.velocity == (0.0, 0.0)
    assert errors.net_covered == errors.velocity_covered == (1.0, 1.0)


def test_what_is_not_judged_does_not_count(walk):
    made = replayed(walk, CHOICES[0])
    before = errors_of(walk, made)
    made.state[~walk.judged] += 1000.0

    for now, then in zip(errors_of(walk, made), before, strict=True):
        assert now == pytest.approx(then, nan_ok=True)


def test_spoiling_is_the_same_each_time(walk):
    for one, other in zip(disturbed(walk), disturbed(walk), strict=True):
        assert np.array_equal(one.recording.position, other.recording.position, equal_nan=True)
        assert np.array_equal(one.recording.effort, other.recording.effort)


@pytest.fixture
def _undrawn(monkeypatch):
    for name in ("draw_question", "draw_coverage"):
        monkeypatch.setattr(f"analysis.ablation_page.{name}", lambda *_: None)


@pytest.mark.usefixtures("_undrawn")
def test_the_page_says_on_how_many_samples_at_rest_it_stands(tmp_path, walk, results):
    """A share of ten samples is no share of a thousand."""
    few = summary(walk)._replace(rest_count=(123456, 10))
    low = results[ACTIVE, SHIPPED]._replace(patient_at_rest_covered=(1.0, 0.8))

    found = over_seeds([({**results, (ACTIVE, SHIPPED): low}, [few])])
    page = write_page(tmp_path, found, "a command")[0]

    assert "123456 / 10 |" in page.read_text("utf-8")
    assert "slide 0.800 of 10 samples" in page.read_text("utf-8")


def test_over_seeds_each_figure_is_the_median_and_the_page_has_the_range(tmp_path, walk, results):
    shipped, whole = results[ACTIVE, SHIPPED], summary(walk)
    draws = [
        ({(ACTIVE, SHIPPED): shipped._replace(patient=(hip, math.nan), nis=hip)}, [one])
        for hip, one in ((0.3, whole), (0.1, whole._replace(ended="a stop")), (0.2, whole))
    ]

    found = over_seeds(draws)
    page = write_page(tmp_path, found, "a command")[0].read_text("utf-8")

    median = found.medians[ACTIVE, SHIPPED]
    assert (median.patient[0], median.nis, median.net) == (0.2, 0.2, shipped.net)
    assert np.isnan(median.patient[1])
    assert found.summaries[0].ended == "a stop; 1 of 3 seeds"
    assert found.summaries[0].rest_count == tuple(3 * one for one in whole.rest_count)
    assert f"| {ACTIVE} | 0.2 (0.1 … 0.3) N·m | – |" in page


def test_a_number_is_as_precise_as_it_deserves():
    numbers = (0.114, 1.09, 12.44, 119.7, math.nan)

    assert [three_digits(one) for one in numbers] == ["0.11", "1.09", "12.4", "120", "–"]


def test_the_command_refuses_a_configuration_that_is_not_there(tmp_path):
    ran = gaitd("ablation", "--quick", "--config", tmp_path / "no.toml")

    assert ran.code == 2
    assert "no.toml" in ran.err


@pytest.mark.usefixtures("_undrawn")
def test_the_command_prints_a_table_for_each_question_and_writes_the_page(
    walk, tmp_path, monkeypatch
):
    plan = [Planned(ACTIVE, lambda _: walk)]
    monkeypatch.setattr("gaitd_lab.ablation_trials.planned", lambda _, *, quick, seed: plan)

    ran = gaitd("ablation", "--quick", "--seeds", 1, "--output", tmp_path, "--json")

    assert ran.code == 0, ran.err
    for title in ("Coriolis torque", "without Coriolis"):
        assert title in ran.err
    assert "gaitd ablation --seeds 1 --quick" in (tmp_path / "ablation.md").read_text("utf-8")
    document = json.loads(ran.out)
    assert (document["seeds"], document["trials"][0]["situation"]) == (1, ACTIVE)
    assert {one["choice"] for one in document["results"]} == {one.name for one in CHOICES}
