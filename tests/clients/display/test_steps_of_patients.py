"""What the page says of patients who walk the shipped gait, on the real observer and core."""

import pytest
from assisted import Answers, leg_controller
from gaitd_display.walk import OwnSteps, word_of
from gaitd_display.words import Word
from gaitd_session import Band

from daemon.gateway import strides, translate
from gaitd_lab.patients import of_ability

STRIDES = 2
BAND = Band(0.4, 0.7)


class Watched(Answers):
    """The reference controller, and the page's judgement of each stride."""

    def __init__(self):
        super().__init__(leg_controller())
        self.steps = OwnSteps(BAND)

    def __call__(self, record):
        view = translate.view_of(record.legs[0], record, translate.stamp_of("lockstep", record))
        if view.leg.stride is not None:
            self.steps.take(strides.stride(view.leg.stride, view, record.cycle))
        return super().__call__(record)


def walked(gym, model):
    watched = Watched()
    gym.walk(model, STRIDES, watched)
    return watched.steps.steps


@pytest.mark.parametrize(
    ("ability", "word"),
    [
        (0.0, Word.MORE),
        pytest.param(0.5, Word.GOOD, marks=pytest.mark.thorough),
        pytest.param(1.4, Word.GENTLY, marks=pytest.mark.thorough),
        (-0.5, Word.RELAX),
    ],
)
def test_the_word_says_what_a_patient_does_of_what_the_gait_needs(warm_gym, ability, word):
    assert word_of(walked(warm_gym, of_ability(ability))) == word
