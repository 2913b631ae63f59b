"""What an operator is asked to do after a refusal."""

import pytest

from daemon.gateway.translate import refusal_message
from daemon.ipc.report import Refusal, RefusalCode, Untested
from gaitd.operator_texts import HOLD_SWITCH, PRESS, RELEASE, prompt


@pytest.mark.parametrize(
    ("refusal", "text"),
    [
        (Refusal(RefusalCode.HAND_SWITCH_OPEN), HOLD_SWITCH),
        (Refusal(RefusalCode.STO_ACTIVE), RELEASE),
        (Refusal(RefusalCode.INPUT_UNTESTED, "right/hip", (Untested.STO_ACTIVE,)), PRESS),
        (Refusal(RefusalCode.NO_PLAN), "waiting: as told"),
    ],
)
def test_a_state_to_be_seen_asks_for_another_thing_than_the_refusal_of_its_name(refusal, text):
    assert prompt("as told", refusal_message(refusal)) == text


def test_a_refusal_without_a_code_is_shown_as_it_was_told():
    assert prompt("no answer", None) == "waiting: no answer"
