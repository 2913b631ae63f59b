"""The ablation: every choice on and off. `test_ablation_claims.py` has what the page says."""

import json
import math

import numpy as np
import pytest
from command_line import gaitd

from daemon.config.robot import leg_parameters, observer_tuning
from gaitd_lab.studies.ablation.choices import CHOICES, SHIPPED
from gaitd_lab.studies.ablation.errors import (
    Errors,
    ablate,
    disturbed,
    errors_of,
    replayed,
    rest_counts,
)
from gaitd_lab.studies.ablation.questions import QUESTIONS
from gaitd_lab.studies.ablation.study import Recorded, report
from gaitd_lab.studies.ablation.trials import Planned
from gaitd_lab.studies.report import Measured
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
    asked = {choice for question in QUESTIONS for choice in question.choices}

    assert asked == {choice.name for choice in CHOICES}
    assert all(question.choices[0] == SHIPPED for question in QUESTIONS)


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


def test_a_report_has_median_and_range_of_the_draws_and_what_stopped_them(walk, results):
    shipped = results[ACTIVE, SHIPPED]
    draws = [shipped._replace(patient=(hip, math.nan), nis=hip) for hip in (0.3, 0.1, 0.2)]
    recorded = Recorded(rest_counts(walk), ("a stop",))

    table, *_ = report({(ACTIVE, SHIPPED): draws}, {ACTIVE: recorded}, 3).tables

    (cells,) = table.rows
    row = dict(zip(table.head, cells, strict=True))
    assert row["moving, hip"] == Measured(0.2, 0.1, 0.3, "N·m")
    assert row["moving, slide"] is None
    assert row["NIS"] == 0.2
    assert row["ended early"] == "1 of 3: a stop"
    assert row["samples at rest"] == " / ".join(map(str, rest_counts(walk)))


def test_the_command_refuses_a_configuration_that_is_not_there(tmp_path):
    ran = gaitd("ablation", "--quick", "--config", tmp_path / "no.toml")

    assert ran.code == 2
    assert "no.toml" in ran.err


def test_the_command_prints_and_writes_a_table_for_each_question(
    walk, results, tmp_path, monkeypatch
):
    plan = [Planned(ACTIVE, lambda _: walk)]
    place = "gaitd_lab.studies.ablation.study.planned"
    monkeypatch.setattr(place, lambda _, *, quick, seed: plan)
    monkeypatch.setattr("gaitd_lab.studies.ablation.study.ablate", lambda _: results)

    ran = gaitd("ablation", "--quick", "--seeds", 1, "--output", tmp_path, "--json")

    assert ran.code == 0, ran.err
    page = (tmp_path / "ablation.md").read_text("utf-8")
    assert "`gaitd ablation --seeds 1 --quick` wrote these numbers" in page
    asked = [one for one in QUESTIONS if ACTIVE in one.situations]
    first, *others = json.loads(ran.out)
    assert [row[0] for row in first["rows"]] == [ACTIVE]
    assert [one["title"] for one in others] == [one.title for one in asked]
    for question, table in zip(asked, others, strict=True):
        assert question.title in ran.err
        assert [row[1] for row in table["rows"]] == list(question.choices)
        assert (tmp_path / f"ablation_{question.key}.png").is_file()
