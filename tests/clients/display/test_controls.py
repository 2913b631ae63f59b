"""What the therapist's page offers, row by row, and beside the service's own table."""

import itertools

import pytest
from gaitd_client import Mode, Stage
from gaitd_display.controls import Command, Does, Requestable, WhyNot, controls

from daemon.core.modes import roles
from daemon.core.modes.table import TRANSITIONS, trigger_of
from daemon.ipc import record
from daemon.wire.roles import Role

ENABLE, HOLD, GUIDE, TEST, DISABLE, RESET = Command
NOTHING = dict.fromkeys(Command, WhyNot.UNKNOWN)
WALKING = {
    ENABLE: WhyNot.IS_ON,
    HOLD: Does.ENDS_WALKING,
    GUIDE: WhyNot.NOT_HELD,
    TEST: WhyNot.NOT_HELD,
    DISABLE: WhyNot.NOT_HELD,
    RESET: WhyNot.NO_STOP,
}
READY = {
    ENABLE: Does.HOLDS_THE_LEG,
    HOLD: WhyNot.IS_OFF,
    GUIDE: WhyNot.IS_OFF,
    TEST: WhyNot.IS_OFF,
    DISABLE: WhyNot.IS_OFF,
    RESET: WhyNot.NO_STOP,
}
HELD = {
    ENABLE: WhyNot.IS_ON,
    HOLD: WhyNot.IS_HELD,
    GUIDE: Does.CARRIES_THE_WEIGHT,
    TEST: Does.MOVES_A_LITTLE,
    DISABLE: Does.LETS_GO,
    RESET: WhyNot.NO_STOP,
}
STOPPED = {**dict.fromkeys(Command, WhyNot.STOP_FIRST), RESET: Does.LETS_GO_UNTIL_ENABLED}
ONE_AXIS = {
    **dict.fromkeys(Command, WhyNot.ONE_AXIS),
    DISABLE: Does.ENDS_ONE_AXIS,
    RESET: WhyNot.NO_STOP,
}
WELL = {"hand_switch_closed": True, "sto_released": True}
ROWS = [
    (Requestable(None), NOTHING),
    (Requestable("of_a_later_version", **WELL), NOTHING),
    (Requestable(Mode.OFF, **WELL), dict.fromkeys(Command, WhyNot.GETTING_READY)),
    (Requestable(Mode.BRINGING_UP, **WELL), dict.fromkeys(Command, WhyNot.GETTING_READY)),
    (Requestable(Mode.STOPPING, **WELL), dict.fromkeys(Command, WhyNot.STOPPING)),
    # a stop that was not reset: without a drive nothing starts; in READY it is reset
    (
        Requestable(Mode.OFF, is_latched=True, **WELL),
        dict.fromkeys(Command, WhyNot.DOES_NOT_START),
    ),
    (
        Requestable(Mode.BRINGING_UP, is_latched=True, **WELL),
        dict.fromkeys(Command, WhyNot.DOES_NOT_START),
    ),
    (
        Requestable(Mode.READY, is_latched=True, has_power=False, **WELL),
        READY | {RESET: Does.CLEARS_THE_STOP},
    ),
    # ready
    (Requestable(Mode.READY, **WELL), READY),
    (Requestable(Mode.READY), READY),  # inputs that are not known are left to the service
    (
        Requestable(Mode.READY, hand_switch_closed=False, sto_released=True),
        READY | {ENABLE: WhyNot.HAND_SWITCH},
    ),
    (
        Requestable(Mode.READY, hand_switch_closed=False, sto_released=False),
        READY | {ENABLE: WhyNot.EMERGENCY_STOP},
    ),
    (Requestable(Mode.READY, **WELL, knows_position=False), READY | {ENABLE: WhyNot.POSITION}),
    # held, and in motion
    (Requestable(Mode.HOLD, **WELL), HELD),
    (
        Requestable(Mode.HOLD, Stage.PREPARING, **WELL),
        HELD | {GUIDE: WhyNot.GETTING_READY, TEST: WhyNot.GETTING_READY},
    ),
    (Requestable(Mode.GAIT, Stage.PLAYING, **WELL), WALKING),
    (Requestable(Mode.GAIT, Stage.ANNOUNCING, **WELL), WALKING | {HOLD: Does.CANCELS_WALKING}),
    (Requestable(Mode.GAIT, Stage.PREPARING, "a law"), WALKING | {HOLD: Does.CANCELS_WALKING}),
    (Requestable(Mode.GAIT, Stage.PLAYING, "a law", **WELL), WALKING | {HOLD: Does.ENDS_ASSIST}),
    (Requestable(Mode.TORQUE, Stage.PLAYING, "a law", **WELL), WALKING | {HOLD: Does.ENDS_MOTION}),
    (Requestable(Mode.TORQUE, Stage.PLAYING, **WELL), WALKING | {HOLD: Does.ENDS_MOTION}),
    (Requestable(Mode.EXCITE, Stage.PLAYING, **WELL), WALKING | {HOLD: Does.ENDS_MOTION}),
    (Requestable(Mode.HAND_GUIDING, None, "a law"), WALKING | {HOLD: Does.ENDS_MOTION}),
    (Requestable(Mode.SELF_TEST, Stage.ANNOUNCING), WALKING | {HOLD: Does.ENDS_MOTION}),
    (Requestable(Mode.REFERENCE, **WELL), ONE_AXIS),
    (Requestable(Mode.COMMISSION, **WELL), ONE_AXIS),
    # stopped
    (Requestable(Mode.FAULT, **WELL), STOPPED),
    (Requestable(Mode.FAULT), STOPPED),
    (Requestable(Mode.FAULT, **WELL, has_power=False), STOPPED | {RESET: Does.CLEARS_THE_STOP}),
    (
        Requestable(Mode.FAULT, hand_switch_closed=False, sto_released=True, has_power=False),
        STOPPED | {RESET: WhyNot.HAND_SWITCH},
    ),
    (Requestable(Mode.FAULT, sto_released=False), STOPPED | {RESET: WhyNot.EMERGENCY_STOP}),
]


def decided(now):
    return {one.command: one.does or one.why_not for one in controls(now)}


@pytest.mark.parametrize(("now", "wanted"), ROWS, ids=[f"{now.mode}" for now, _ in ROWS])
def test_what_a_button_does_follows_from_mode_and_reason(now, wanted):
    assert decided(now) == wanted
    assert [one.does is None for one in controls(now)] == sorted(
        one.does is None for one in controls(now)
    )


def test_every_mode_has_a_row():
    assert {now.mode for now, _ in ROWS} >= set(Mode)


def request_of(command):
    """The request of a button, as the service sees it."""
    if command in {ENABLE, DISABLE, RESET}:
        return record.RequestKind[command.name], record.ModeRequest()
    return record.RequestKind.MODE, record.ModeRequest(mode=record.Mode[command.name])


HERE_ALONE = {
    *((mode, DISABLE) for mode in (Mode.GAIT, Mode.TORQUE, Mode.EXCITE)),
    *((mode, DISABLE) for mode in (Mode.HAND_GUIDING, Mode.SELF_TEST)),
    (Mode.READY, RESET),
}
"""What the service would do, and the page does not offer: the leg would not be held afterwards, or
there is no stop that a reset would end."""


def test_what_is_offered_is_what_the_service_s_table_allows_but_for_what_the_page_says():
    for mode, command in itertools.product(Mode, Command):
        offered = isinstance(decided(Requestable(mode, **WELL))[command], Does)
        kind, wanted = request_of(command)
        row = (record.Mode[mode.name], trigger_of(kind, wanted))
        is_allowed = row in TRANSITIONS
        assert offered == (is_allowed and (mode, command) not in HERE_ALONE), (mode, command)


def test_no_button_is_beyond_the_rights_of_an_operator():
    for command in Command:
        kind, wanted = request_of(command)
        request = record.Request(1, kind, 0, wanted, Role.OPERATOR)
        assert roles.refusal(request, None) is None
