"""The ablation: every choice on and off, and what the page claims of them."""

import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.ablation import (
    GLITCHES,
    JITTER_NOMINAL,
    JITTER_TRUE,
    LATE,
    RIPPLED,
    Errors,
    ablate,
    errors_of,
    replayed,
    spoiled,
    summary,
)
from analysis.ablation_choices import CHOICES, SHIPPED
from analysis.ablation_figures import answered, three_digits
from analysis.ablation_page import figure_name, write_page
from analysis.ablation_questions import QUESTIONS, REST, WRONG
from analysis.trial import Trial
from daemon.config.robot import leg_parameters, observer_tuning
from gaitd.__main__ import build
from gaitd.ablation_trials import planned, record
from gaitd.trials import Situation, Trials
from observer.leg_model import integrator_named
from sim_drives.plant_settings import FrictionLaw

CONFIG = Path(__file__).parents[2] / "configs" / "demo.toml"
PASSIVE = "paper, 0.5 Hz, passive"
ACTIVE = "paper, 0.5 Hz, active"
PAGE_BYTES_MAX = 250_000


@pytest.fixture(scope="module")
def trials() -> dict[str, Trial]:
    return {trial.name: trial for trial in record(planned(CONFIG, quick=True), lambda _: _nobody)}


@pytest.fixture(scope="module")
def results(trials) -> dict[tuple[str, str], Errors]:
    found: dict[tuple[str, str], Errors] = {}
    for trial in trials.values():
        found |= ablate(trial)
    return found


def _nobody(_: float) -> None:
    """Nobody watches the progress."""


def test_every_choice_is_replayed_in_every_situation_with_finite_numbers(trials, results):
    assert set(trials) == {
        PASSIVE, ACTIVE, REST, JITTER_TRUE, JITTER_NOMINAL, LATE, RIPPLED, GLITCHES
    }  # fmt: skip
    assert set(results) == {(trial, choice.name) for trial in trials for choice in CHOICES}
    for (situation, choice), errors in results.items():
        always = (*errors.net, *errors.velocity, *errors.net_covered, *errors.ok_share, errors.nis)
        moving = () if situation == REST else (*errors.patient, *errors.friction)
        assert np.isfinite([*always, *moving]).all(), (situation, choice)


def test_each_choice_but_the_first_changes_the_robot(trials):
    robot = trials[PASSIVE].robot

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


def test_coriolis_at_half_a_hertz_takes_nine_tenths_of_a_passive_patients_false_torque(results):
    with_it, without = (results[PASSIVE, name].patient[0] for name in (SHIPPED, "without Coriolis"))

    assert with_it < 0.2
    assert without > 10 * with_it


def test_rising_noise_follows_an_active_patient_and_covers_him_again(results):
    agile, slow = (results[ACTIVE, name] for name in (SHIPPED, "noise never rises"))

    assert agile.patient[0] < 0.8 * slow.patient[0]
    assert agile.patient_covered[0] > 0.98
    assert slow.patient_covered[0] < 0.9


def test_rising_noise_costs_a_passive_patient_nothing(results):
    agile, slow = (results[PASSIVE, name].patient for name in (SHIPPED, "noise never rises"))

    assert agile == pytest.approx(slow, rel=0.05)


def test_the_gate_takes_the_false_activity_at_rest_away(results):
    gated, not_gated = (
        results[REST, name].patient_at_rest for name in (SHIPPED, "not gated at rest")
    )

    assert gated[0] < 0.1
    assert gated[1] < 1.0
    assert not_gated[0] > 3 * gated[0]
    assert not_gated[1] > 3 * gated[1]


def test_true_sample_times_lose_nothing_and_nominal_ones_are_noticed(results):
    true, nominal = results[JITTER_TRUE, SHIPPED], results[JITTER_NOMINAL, SHIPPED]
    told = results[JITTER_NOMINAL, "jitter told"]

    assert true.patient == pytest.approx(results[ACTIVE, SHIPPED].patient, rel=0.1)
    assert nominal.patient[0] > 3 * true.patient[0]
    assert nominal.ok_share[0] < 0.3
    assert told.ok_share[0] > 0.9
    assert min(told.patient_covered) > 0.9


def test_a_delay_that_is_modelled_is_no_error(results):
    clean = results[ACTIVE, SHIPPED].patient

    assert results[LATE, SHIPPED].patient[0] > 2 * clean[0]
    assert results[LATE, "delay told"].patient == pytest.approx(clean, rel=0.1)


def test_a_ripple_that_is_told_is_covered(results):
    untold, told = results[RIPPLED, SHIPPED], results[RIPPLED, "ripple told"]

    assert untold.velocity_covered[1] < 0.95
    assert told.velocity_covered[1] > 0.99


def test_glitches_leave_no_trace_behind_their_gate(results):
    assert results[GLITCHES, SHIPPED].patient == pytest.approx(
        results[ACTIVE, SHIPPED].patient, rel=0.1
    )
    assert results[GLITCHES, "glitch gate open"].patient[0] > 1.0


def test_the_papers_tuning_takes_half_of_an_active_patient_for_friction(results):
    paper, shipped = results[ACTIVE, "paper's noise"], results[ACTIVE, SHIPPED]

    assert paper.patient[0] > 3 * shipped.patient[0]
    assert paper.friction[0] > 3 * shipped.friction[0]


def test_rk4_has_less_error_of_friction_than_semi_implicit_steps(results):
    by_name = {name: results[PASSIVE, name].friction[1] for _, name in results}

    assert by_name[SHIPPED] < 0.5 * by_name["semi-implicit x2"]
    assert by_name["semi-implicit x2"] < 0.7 * by_name["semi-implicit x1"]


def test_without_a_friction_model_friction_is_the_patient(trials, results):
    level_nm = trials[PASSIVE].robot.friction.hip.coulomb_nm

    assert results[PASSIVE, "no friction model"].patient[0] > level_nm


@pytest.mark.parametrize("name", ["friction told 20 % low", "friction told 20 % high"])
def test_wrong_friction_is_an_error_of_that_friction_which_net_does_not_have(trials, results, name):
    errors, right = results[PASSIVE, name], results[PASSIVE, SHIPPED]
    wrong_nm = 0.2 * trials[PASSIVE].robot.friction.hip.coulomb_nm

    assert errors.patient[0] == pytest.approx(wrong_nm, rel=0.25)
    assert errors.patient_covered[0] < 0.3 < right.patient_covered[0]
    assert errors.net[0] < 0.5 * wrong_nm


def test_a_load_that_sticking_holds_is_no_patient_with_the_gate():
    trial = Trials(CONFIG).gait(Situation(FrictionLaw.PAPER_STICKING), 15.0)
    results = ablate(trial)
    gated, not_gated = (results[trial.name, name] for name in (SHIPPED, "not gated at rest"))

    assert gated.patient_at_rest[0] < 0.5 * not_gated.patient_at_rest[0]
    assert gated.patient[0] < 0.5 * not_gated.patient[0]
    assert gated.patient_at_rest_covered[0] > 0.9 > not_gated.patient_at_rest_covered[0]


def test_viscous_friction_outside_the_low_pass_suits_bristles_and_not_the_papers_law(results):
    trial = Trials(CONFIG).gait(Situation(FrictionLaw.LUGRE, cadence_hz=0.5), 8.0)
    bristles = ablate(trial)
    inside, outside = (
        bristles[trial.name, name].patient[1] for name in (SHIPPED, "viscous outside")
    )

    assert outside < 0.75 * inside
    assert results[PASSIVE, "viscous outside"].patient[1] > 3 * results[PASSIVE, SHIPPED].patient[1]


def test_the_choices_reach_the_observer(trials):
    robot = trials[PASSIVE].robot
    tunings = {choice.name: observer_tuning(choice.change(robot)) for choice in CHOICES}
    legs = {choice.name: leg_parameters(choice.change(robot)) for choice in CHOICES}

    assert not tunings["without Coriolis"].coriolis
    assert tunings["delay told"].effort_delay_ms == 10.0
    assert legs["leg told 10 % heavy"].shank_inertia > legs[SHIPPED].shank_inertia
    paper = tunings["paper's observer"]
    assert paper.process_std[4] == pytest.approx(10 * paper.process_std[6])


def test_errors_are_zero_and_all_is_covered_where_the_estimate_is_the_truth(trials):
    trial = trials[ACTIVE]
    made = replayed(trial, CHOICES[0])
    made.state[:] = trial.truth
    made.net[:] = trial.truth[:, 6:8] - trial.truth[:, 4:6]

    errors = errors_of(trial, made)

    assert errors.patient == errors.friction == errors.net == errors.velocity == (0.0, 0.0)
    assert errors.net_covered == errors.velocity_covered == (1.0, 1.0)


def test_what_is_not_judged_does_not_count(trials):
    trial = trials[ACTIVE]
    made = replayed(trial, CHOICES[0])
    before = errors_of(trial, made)
    made.state[~trial.judged] += 1000.0

    for now, then in zip(errors_of(trial, made), before, strict=True):
        assert now == pytest.approx(then, nan_ok=True)


def test_spoiling_is_the_same_each_time(trials):
    for one, other in zip(spoiled(trials[ACTIVE]), spoiled(trials[ACTIVE]), strict=True):
        assert np.array_equal(one.recording.position, other.recording.position, equal_nan=True)
        assert np.array_equal(one.recording.effort, other.recording.effort)


def test_the_page_states_coverage_and_shows_a_figure_for_each_question(tmp_path, trials, results):
    written = write_page(tmp_path, results, [summary(one) for one in trials.values()], "a command")
    page = written[0].read_text("utf-8")
    asked = [one for one in (*QUESTIONS, *WRONG) if answered(one, results)[0]]

    assert len(asked) >= 9
    for question in asked:
        assert f"]({figure_name(question)})" in page
        assert (tmp_path / figure_name(question)).stat().st_size < PAGE_BYTES_MAX
    assert "## Measured 3-sigma coverage" in page
    assert f"- {LATE}: " in page
    assert "nan" not in page


def test_the_page_says_on_how_many_samples_at_rest_it_stands(tmp_path, trials, results):
    """A share of ten samples is no share of a thousand."""
    few = summary(trials[PASSIVE])._replace(rest_count=(123456, 10))
    low = results[PASSIVE, SHIPPED]._replace(patient_at_rest_covered=(1.0, 0.8))

    page = write_page(tmp_path, {**results, (PASSIVE, SHIPPED): low}, [few], "a command")[0]

    assert "123456 / 10 |" in page.read_text("utf-8")
    assert "slide 0.800 of 10 samples" in page.read_text("utf-8")


def test_samples_at_rest_are_those_that_are_judged_and_have_rested(trials):
    still, walked = (summary(trials[name]).rest_count for name in (REST, PASSIVE))
    judged = int(trials[REST].judged.sum())

    assert still == (judged, judged)
    assert max(walked) < 0.2 * trials[PASSIVE].judged.sum()


def test_a_number_is_as_precise_as_it_deserves():
    numbers = (0.114, 1.09, 12.44, 119.7, math.nan)

    assert [three_digits(one) for one in numbers] == ["0.11", "1.09", "12.4", "120", "–"]


def test_the_command_refuses_a_configuration_that_is_not_there(tmp_path):
    from daemon.config.strict import ConfigError

    result = CliRunner().invoke(
        build("ablation"), ["ablation", "--quick", "--config", str(tmp_path / "no.toml")]
    )

    assert isinstance(result.exception, ConfigError)


def test_the_command_prints_a_table_for_each_question():
    result = CliRunner().invoke(build("ablation"), ["ablation", "--quick"])

    assert result.exit_code == 0, result.output
    for title in ("Coriolis torque", "Velocity-gated noise", "Parameters that are wrong"):
        assert title in result.output
    assert "without Coriolis" in result.output
