"""The people of a training at real servers of the pages; the trainer is messages alone."""

import time

import browser as rig
import display_bench as bench
import pytest
from gaitd_client import AxisPlan, Mode, PlanLimits
from gaitd_display.login import hash_password
from gaitd_display.patient import PatientServer
from gaitd_display.settings import PatientSettings, TherapistSettings
from gaitd_display.therapist import TherapistServer
from training import PROFILE

from gaitd_lab.demonstration.people import People
from gaitd_lab.processes import free_port

PASSWORD = "abcd-efgh-jkmn"
PLAN = PlanLimits(
    cadence_max_hz=0.5,
    amplitude_max_ratio=0.7,
    duration_max_s=8.0,
    hip=AxisPlan(assist_max=10.0),
    slide=AxisPlan(assist_max=80.0),
)
WITHIN_S = 60.0


@pytest.fixture
def trainer():
    return bench.MessageTrainer()


@pytest.fixture
def therapist_site(trainer, tmp_path):
    table = bench.therapist_table(hash_password(PASSWORD))
    make = lambda made: TherapistServer(made, trainer, trainer.clock)  # noqa: E731
    with rig.Site(make, table, tmp_path, TherapistSettings) as site:
        yield site


@pytest.fixture
def patient_site(trainer, tmp_path):
    (tmp_path / "profile.toml").write_text(PROFILE, encoding="utf-8")
    table = bench.patient_table(tmp_path, target=False)
    table["session"] = {"profile": "profile.toml", "history": "history.sqlite"}
    make = lambda made: PatientServer(made, trainer, trainer.clock)  # noqa: E731
    with rig.Site(make, table, tmp_path, PatientSettings) as site:
        yield site


def wait_for(reached):
    end_s = time.monotonic() + WITHIN_S
    while not (found := reached()):
        assert time.monotonic() < end_s
        time.sleep(0.01)
    return found


def people(patient_port, therapist_port, password=PASSWORD):
    return People(patient_port, therapist_port, password, PLAN)


def outcome(asked):
    wait_for(lambda: asked.outcome()[0])
    return asked.outcome()


def test_a_therapist_logs_in_and_releases_the_plan(therapist_site, trainer):
    with people(free_port(), therapist_site.port) as asked:
        asked.release()

        assert outcome(asked) == ("done", "")
    assert trainer.plan == PLAN


def test_a_therapist_with_a_wrong_password_is_told_so(therapist_site, trainer):
    with people(free_port(), therapist_site.port, "another-one-12") as asked:
        asked.release()

        told, reason = outcome(asked)
    assert (told, "wrong_password" in reason) == ("failed", True)
    assert trainer.plan is None


def test_a_patient_sees_the_page_and_presses_what_it_offers(patient_site, trainer):
    def answer(looking):
        looking.press("start")
        return outcome(looking)[0]

    with people(patient_site.port, free_port()) as looking:

        def is_offered():
            trainer.cycles(Mode.READY, count=20)
            training = looking.seen.training
            return training is not None and "start" in training.buttons

        assert answer(looking) == "refused"
        wait_for(is_offered)
        assert (looking.seen.mode, looking.seen.training.phase) == ("ready", "waiting")
        assert answer(looking) == "done"
        wait_for(lambda: trainer.cycles(Mode.READY) or ("enable",) in trainer.requests)
        patient_site.end()
        wait_for(lambda: looking.seen.training is None)
    patient_site.start()


def test_a_page_that_is_not_there_gives_no_answer():
    with people(free_port(), free_port()) as asked:
        asked.press("start")

        assert outcome(asked)[0] == "unanswered"
