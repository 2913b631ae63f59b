"""What is sure of all drives: one that is silent, or stale, says nothing."""

import display_bench as bench
import pytest
from gaitd_client import Cause, DriveState, NotValid, Trouble
from gaitd_display.drives import Drives, together
from gaitd_texts import Situation, situation_of

NOTHING = Drives(are_holding=False, may_have_power=True, is_switch_held=False)
HELD = Drives(are_holding=True, may_have_power=True, is_switch_held=True)


def drive(power="operation_enabled", switch=True, *, fresh=True):
    return bench.filled(
        DriveState, name="right/hip", fresh=fresh, power_state=power, hand_switch_closed=switch
    )


SILENT = NotValid("right/slide", next(iter(Trouble)), "no message")


@pytest.mark.parametrize(
    ("messages", "wanted"),
    [
        ((), NOTHING),
        ((drive(), SILENT), NOTHING),
        ((drive(), drive(fresh=False)), NOTHING),
        ((drive("fault"), drive("fault", fresh=False)), NOTHING),
        ((drive(), drive()), HELD),
        ((drive(), drive("quick_stop_active")), HELD),
        ((drive(), drive("fault")), HELD._replace(are_holding=False)),
        ((drive(), drive(switch=None)), HELD._replace(is_switch_held=False)),
        ((drive("fault"), drive("ready_to_switch_on")), Drives(False, False, True)),
    ],
)
def test_what_a_drive_is_shown_to_be_follows_from_its_messages(messages, wanted):
    assert together(messages) == wanted


def test_a_leg_that_a_stop_would_hold_is_called_loose_unless_each_drive_says_that_it_holds():
    assert situation_of(Cause.SPASM, are_holding=True) is Situation.HELD
    assert situation_of(Cause.SPASM, are_holding=False) is Situation.LOOSE
    assert situation_of("of a later version", are_holding=False) is Situation.DANGER
