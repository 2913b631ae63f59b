"""What docs/evidence/ablation.md says, on short trials; `test_ablation.py` has the machinery."""

import numpy as np
import pytest
from sessions import CONFIGS

from gaitd_lab.studies.ablation.choices import CHOICES, SHIPPED
from gaitd_lab.studies.ablation.errors import (
    GLITCHES,
    JITTER_NOMINAL,
    JITTER_TRUE,
    LATE,
    RIPPLED,
    Errors,
    ablate,
    rest_counts,
)
from gaitd_lab.studies.ablation.questions import REST
from gaitd_lab.studies.ablation.trials import planned, record
from gaitd_lab.trial import Trial
from gaitd_lab.trials import Situation, Trials
from sim_drives.plant.settings import FrictionLaw

pytestmark = pytest.mark.thorough

CONFIG = CONFIGS / "demo.toml"
PASSIVE = "paper, 0.5 Hz, passive"
ACTIVE = "paper, 0.5 Hz, active"
OUTSIDE_3_SIGMA = 0.0027
"""Share of normal errors beyond three times their standard deviation."""


@pytest.fixture(scope="module")
def trials() -> dict[str, Trial]:
    made = record(planned(CONFIG, quick=True), lambda _: lambda _: None)
    return {trial.name: trial for trial in made}


@pytest.fixture(scope="module")
def results(trials) -> dict[tuple[str, str], Errors]:
    found: dict[tuple[str, str], Errors] = {}
    for trial in trials.values():
        found |= ablate(trial)
    return found


def test_every_choice_is_replayed_in_every_situation_with_finite_numbers(trials, results):
    assert set(trials) == {
        PASSIVE, ACTIVE, REST, JITTER_TRUE, JITTER_NOMINAL, LATE, RIPPLED, GLITCHES
    }  # fmt: skip
    assert set(results) == {(trial, choice.name) for trial in trials for choice in CHOICES}
    for (situation, choice), errors in results.items():
        always = (*errors.net, *errors.velocity, *errors.net_covered, *errors.ok_share, errors.nis)
        moving = () if situation == REST else (*errors.patient, *errors.friction)
        assert np.isfinite([*always, *moving]).all(), (situation, choice)


def test_coriolis_at_half_a_hertz_takes_nine_tenths_of_a_passive_patients_false_torque(results):
    with_it, without = (results[PASSIVE, name].patient[0] for name in (SHIPPED, "without Coriolis"))

    assert with_it < 0.2
    assert without > 10 * with_it


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
    told = results[JITTER_NOMINAL, "jitter configured"]

    assert true.patient == pytest.approx(results[ACTIVE, SHIPPED].patient, rel=0.1)
    assert nominal.patient[0] > 3 * true.patient[0]
    assert nominal.ok_share[0] < 0.3
    assert told.ok_share[0] > 0.9
    assert min(told.patient_covered) > 0.9


def test_a_delay_that_is_modelled_is_no_error(results):
    clean = results[ACTIVE, SHIPPED].patient

    assert results[LATE, SHIPPED].patient[0] > 2 * clean[0]
    assert results[LATE, "delay configured"].patient == pytest.approx(clean, rel=0.1)


def test_a_ripple_that_is_told_is_covered(results):
    untold, told = results[RIPPLED, SHIPPED], results[RIPPLED, "ripple configured"]

    assert 1.0 - untold.velocity_covered[1] > 10 * OUTSIDE_3_SIGMA
    assert told.velocity_covered[1] > 0.99


def test_glitches_leave_no_trace_behind_their_gate(results):
    assert results[GLITCHES, SHIPPED].patient == pytest.approx(
        results[ACTIVE, SHIPPED].patient, rel=0.1
    )
    assert results[GLITCHES, "glitch gate open"].patient[0] > 1.0


def test_rk4_has_less_error_of_friction_than_semi_implicit_steps(results):
    by_name = {name: results[PASSIVE, name].friction[1] for _, name in results}

    assert by_name[SHIPPED] < 0.5 * by_name["semi-implicit x2"]
    assert by_name["semi-implicit x2"] < 0.7 * by_name["semi-implicit x1"]


def test_without_a_friction_model_friction_is_the_patient(trials, results):
    level_nm = trials[PASSIVE].robot.friction.hip.coulomb_nm

    assert results[PASSIVE, "no friction model"].patient[0] > level_nm


@pytest.mark.parametrize("name", ["friction set 20 % low", "friction set 20 % high"])
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


def test_samples_at_rest_are_those_that_are_judged_and_have_rested(trials):
    still, walked = (rest_counts(trials[name]) for name in (REST, PASSIVE))
    judged = int(trials[REST].judged.sum())

    assert still == (judged, judged)
    assert max(walked) < 0.2 * trials[PASSIVE].judged.sum()
