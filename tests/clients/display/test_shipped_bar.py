"""The shipped bar, with patients who walk the shipped gait on the real observer and core."""

import tomllib
from pathlib import Path

import msgspec
import pytest
from assisted import Answers, Gym, shipped
from gaitd_display.feedback import LegFeedback, Result
from gaitd_display.settings import Bar

from daemon.gateway import translate
from gaitd_lab.patients import of_ability

FILE = Path(__file__).parents[3] / "clients" / "display" / "configs" / "patient.toml"
STRIDES = 3


@pytest.fixture(scope="session")
def warm_gym():
    return Gym()


class Watched(Answers):
    """The reference controller, and the page's judgement of each stride."""

    def __init__(self):
        super().__init__(shipped().controller())
        (bar,) = tomllib.loads(FILE.read_text(encoding="utf-8"))["bar"]
        self.feedback = LegFeedback(msgspec.convert(bar, Bar))

    def __call__(self, record):
        view = translate.view_of(record.legs[0], record, translate.stamp_of("lockstep", record))
        self.feedback.take(translate.activity(view, record.cycle))
        return super().__call__(record)


def result_of(gym, model):
    watched = Watched()
    gym.walk(model, STRIDES, watched)
    return watched.feedback.result


@pytest.mark.parametrize(
    ("share", "result"),
    [(0.0, Result.BELOW), (0.5, Result.WITHIN), (1.0, Result.WITHIN), (1.4, Result.WITHIN)],
)
def test_a_patient_who_does_a_share_of_what_the_gait_needs_is_praised(warm_gym, share, result):
    assert result_of(warm_gym, of_ability(share)) == result


def test_the_active_patient_of_the_demonstration_is_praised(warm_gym):
    trainer = warm_gym.session.machine.trainers["right"]
    warm_gym.session.gateway._on_record = None
    trainer.exert(0.0, 0.0)
    warm_gym.session.command("patient active")

    assert result_of(warm_gym, of_ability(0.0)) == Result.WITHIN
