"""What the mode table as a whole keeps to, and every guard at its limits and beside them."""

from dataclasses import FrozenInstanceError, replace

import msgspec
import pytest
from safety_inputs import ALL_WELL

from daemon.core.modes.table import (
    NO_RULES,
    TRANSITIONS,
    Event,
    event_of,
    refusal,
    rules_of,
)
from daemon.ipc.record import Mode, ModeRequest, RequestKind

NOTHING_WELL = replace(
    ALL_WELL,
    gateway_alive=False,
    at_rest=False,
    hand_switch_closed=False,
    hand_switch_known=True,
    sto_released=False,
    unreferenced=("right/hip",),
    outside=("right/slide",),
    drives_powered=False,
    patient_configured=True,
)
EXERCISES = {
    Mode.GAIT: Event.TO_GAIT,
    Mode.TORQUE: Event.TO_TORQUE,
    Mode.EXCITE: Event.TO_EXCITE,
    Mode.HAND_GUIDING: Event.TO_HAND_GUIDING,
    Mode.SELF_TEST: Event.TO_SELF_TEST,
}
PREPARATIONS = {Mode.REFERENCE: Event.TO_REFERENCE, Mode.COMMISSION: Event.TO_COMMISSION}
GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=10.0)


def rows_of(mode):
    return {event: to for (source, event), to in TRANSITIONS.items() if source == mode}


def rows_into(mode):
    return {pair for pair, to in TRANSITIONS.items() if to == mode}


def ask(mode, **now):
    """Ask for a mode in HOLD."""
    wanted = mode if isinstance(mode, ModeRequest) else ModeRequest(mode)
    return refusal(RequestKind.MODE, wanted, replace(ALL_WELL, mode=Mode.HOLD, **now))


FLAGS = {
    "by_torque": {Mode.TORQUE, Mode.EXCITE, Mode.HAND_GUIDING, Mode.SELF_TEST},
    "needs_impedance": {Mode.TORQUE},
    "takes_assist": {Mode.GAIT, Mode.TORQUE},
    "is_guided_motion": {Mode.GAIT, Mode.SELF_TEST},
    "needs_self_test": {Mode.GAIT, Mode.TORQUE, Mode.EXCITE},
}


@pytest.mark.parametrize("flag", FLAGS)
def test_each_rule_holds_in_its_modes_and_in_no_other(flag):
    assert {mode for mode in Mode if getattr(rules_of(mode), flag)} == FLAGS[flag]


@pytest.mark.parametrize("mode", EXERCISES)
def test_an_exercise_begins_in_hold_alone_and_ends_there_by_itself_and_on_request(mode):
    assert rows_into(mode) == {(Mode.HOLD, EXERCISES[mode])}
    assert rows_of(mode)[Event.TO_HOLD] == Mode.HOLD
    assert rows_of(mode)[Event.EXERCISE_OVER] == Mode.HOLD
    assert set(rows_of(mode).values()) == {Mode.HOLD, Mode.STOPPING}


def test_assist_that_lapses_ends_torque_and_gait_in_hold_and_is_no_matter_elsewhere():
    lapses = {mode: to for (mode, event), to in TRANSITIONS.items() if event is Event.LEASE_LAPSED}

    assert lapses == {Mode.GAIT: Mode.HOLD, Mode.TORQUE: Mode.HOLD}


def test_a_stop_that_was_latched_before_this_start_ends_bring_up_in_fault():
    assert rows_of(Mode.BRINGING_UP)[Event.STILL_LATCHED] == Mode.FAULT


@pytest.mark.parametrize("mode", PREPARATIONS)
def test_one_axis_alone_is_moved_out_of_ready_and_stops_however_it_ends(mode):
    assert rows_into(mode) == {(Mode.READY, PREPARATIONS[mode])}
    assert rows_of(mode) == dict.fromkeys(
        (Event.EXERCISE_OVER, Event.DISABLE, Event.STOP), Mode.STOPPING
    )


def test_holding_begins_by_enable_and_is_what_every_exercise_falls_back_to():
    assert rows_of(Mode.READY)[Event.ENABLE] == Mode.HOLD
    assert {mode for mode, _ in rows_into(Mode.HOLD)} == {Mode.READY, *EXERCISES}


def test_a_stop_ends_in_ready_if_it_was_asked_for_and_in_fault_by_a_verdict():
    assert rows_of(Mode.STOPPING) == {
        Event.AT_REST_WELL: Mode.READY,
        Event.AT_REST_STOPPED: Mode.FAULT,
    }


def test_ready_is_reached_by_a_whole_bring_up_and_by_a_stop_as_asked_and_by_nothing_else():
    assert rows_into(Mode.READY) == {
        (Mode.BRINGING_UP, Event.BRING_UP_DONE),
        (Mode.STOPPING, Event.AT_REST_WELL),
    }


def test_drives_are_brought_up_from_off_alone():
    assert rows_of(Mode.OFF) == {Event.BRING_UP_BEGUN: Mode.BRINGING_UP}
    assert rows_into(Mode.BRINGING_UP) == {(Mode.OFF, Event.BRING_UP_BEGUN)}


@pytest.mark.parametrize("mode", [Mode.BRINGING_UP, Mode.READY])
def test_a_drive_that_is_lost_before_anything_is_enabled_is_off_and_a_faulty_one_a_fault(mode):
    assert rows_of(mode)[Event.DRIVES_LOST] == Mode.OFF
    assert rows_of(mode)[Event.DRIVE_FAULTY] == Mode.FAULT


def test_drives_get_other_limits_by_being_brought_up_anew():
    assert rows_of(Mode.READY)[Event.RESET] == Mode.OFF
    assert rows_of(Mode.READY)[Event.BRING_UP_RESTARTED] == Mode.OFF


def test_every_event_has_words_of_its_own():
    assert all(event.value for event in Event)
    assert len({event.value for event in Event}) == len(Event)


@pytest.mark.parametrize(
    ("kind", "event"),
    [
        (RequestKind.ENABLE, Event.ENABLE),
        (RequestKind.DISABLE, Event.DISABLE),
        (RequestKind.RESET, Event.RESET),
    ],
)
def test_a_request_asks_for_its_event_whatever_mode_it_names(kind, event):
    for mode in Mode:
        assert event_of(kind, ModeRequest(mode)) is event


def test_a_mode_that_the_core_enters_by_itself_has_no_rules():
    by_itself = [mode for mode in Mode if rules_of(mode) is NO_RULES]

    assert by_itself == [Mode.OFF, Mode.BRINGING_UP, Mode.READY, Mode.STOPPING, Mode.FAULT]


def test_one_can_ask_for_hold_for_an_exercise_for_a_preparation_and_for_no_other_mode():
    wanted = {Mode.HOLD: Event.TO_HOLD} | EXERCISES | PREPARATIONS

    for mode in Mode:
        assert event_of(RequestKind.MODE, ModeRequest(mode)) is wanted.get(mode)


def test_what_the_guards_look_at_is_not_altered_by_looking():
    with pytest.raises(FrozenInstanceError):
        ALL_WELL.at_rest = False  # type: ignore[misc]


# --- the guards -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode.active])
def test_disable_needs_nothing_to_be_well(mode):
    assert refusal(RequestKind.DISABLE, ModeRequest(), replace(NOTHING_WELL, mode=mode)) == ""


@pytest.mark.parametrize("mode", EXERCISES)
def test_going_back_to_hold_needs_nothing_to_be_well(mode):
    hold = ModeRequest(Mode.HOLD)

    assert refusal(RequestKind.MODE, hold, replace(NOTHING_WELL, mode=mode)) == ""


@pytest.mark.parametrize("mode", EXERCISES)
def test_no_exercise_begins_while_the_drives_do_not_hold_yet(mode):
    assert ask(mode, drives_powered=False, lease_held=True) == "the drives are not holding yet"


def test_torque_is_for_whoever_holds_the_lease():
    assert ask(Mode.TORQUE, lease_held=True) == ""
    assert "needs a lease" in ask(Mode.TORQUE, lease_held=False)


MOVING = {Mode.GAIT: GAIT, Mode.TORQUE: ModeRequest(Mode.TORQUE)} | {
    Mode.EXCITE: ModeRequest(Mode.EXCITE, duration_s=1.0, scenario="friction")
}


@pytest.mark.parametrize("mode", EXERCISES)
def test_before_the_test_of_the_day_no_leg_is_moved_but_by_hand_and_by_the_test(mode):
    answer = ask(MOVING.get(mode, mode), lease_held=True, self_test_due="not tested today")

    assert answer == ("not tested today: `gaitd self-test`" if mode in MOVING else "")


def test_enable_names_what_was_not_seen_to_act_today():
    now = replace(ALL_WELL, inputs_untested=("hand switch", "safe torque off"))

    answer = refusal(RequestKind.ENABLE, ModeRequest(), now)

    assert answer == "not seen to act today: hand switch, safe torque off"


def test_enable_names_every_axis_whose_sign_is_not_proven_and_what_to_do():
    now = replace(ALL_WELL, unproven=("right/hip", "right/slide"))

    answer = refusal(RequestKind.ENABLE, ModeRequest(), now)

    assert (
        answer == "the sign is not proven: right/hip, right/slide: run `gaitd commission` for each"
    )


@pytest.mark.parametrize("key", ["unreferenced", "outside"])
def test_enable_names_every_axis_that_is_in_the_way(key):
    now = replace(ALL_WELL, **{key: ("right/hip", "right/slide")})

    answer = refusal(RequestKind.ENABLE, ModeRequest(), now)

    assert answer.endswith(": right/hip, right/slide")


@pytest.mark.parametrize("mode", PREPARATIONS)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, ""),
        ({"patient_configured": True}, "a patient is configured"),
        ({"gateway_alive": False}, "the gateway is not alive"),
        ({"hand_switch_closed": False}, "the hand switch is open"),
        ({"sto_released": False}, "safe torque off is active"),
        ({"at_rest": False}, "the leg is moving"),
    ],
)
def test_one_axis_alone_is_moved_in_the_empty_machine_at_rest_with_the_switch_held(
    mode, change, words
):
    answer = refusal(RequestKind.MODE, ModeRequest(mode), replace(ALL_WELL, **change))

    assert answer == words if not words else answer.endswith(words)


@pytest.mark.parametrize("mode", PREPARATIONS)
def test_what_a_witness_saw_is_taken_down_without_any_motion_and_so_without_a_guard(mode):
    seen = ModeRequest(mode, witnessed=True)

    assert refusal(RequestKind.MODE, seen, replace(NOTHING_WELL, mode=Mode.READY)) == ""


@pytest.mark.parametrize("key", ["at_rest", "hand_switch_closed", "sto_released"])
def test_a_reset_without_a_fault_only_brings_up_anew_and_waits_for_nothing(key):
    ready = replace(ALL_WELL, mode=Mode.READY, **{key: False})

    assert refusal(RequestKind.RESET, ModeRequest(), ready) == ""


TINY = 5e-324
"""The least number above zero."""


@pytest.mark.parametrize(
    ("key", "granted", "refused"),
    [
        (
            "cadence_hz",
            (0.02, 0.25, 0.5),
            (-0.25, 0.0, 0.01999, 0.5000001, float("inf"), float("nan")),
        ),
        ("amplitude_ratio", (TINY, 0.5, 1.0), (-0.5, 0.0, 1.0000001, float("nan"))),
        ("duration_s", (TINY, 0.5, 3600.0), (-1.0, 0.0, 3600.001, float("inf"), float("nan"))),
    ],
)
def test_a_gait_is_granted_up_to_each_limit_and_not_beyond(key, granted, refused):
    for value in granted:
        assert ask(msgspec.structs.replace(GAIT, **{key: value})) == ""
    for value in refused:
        assert ask(msgspec.structs.replace(GAIT, **{key: value})).startswith(f"{key} = {value:g}")


@pytest.mark.parametrize(
    ("duration_s", "words"),
    [
        (TINY, ""),
        (0.5, ""),
        (60.0, ""),
        (-1.0, "duration_s = -1, allowed > 0 and <= 60"),
        (0.0, "duration_s = 0, allowed > 0 and <= 60"),
        (60.001, "duration_s = 60.001, allowed > 0 and <= 60"),
        (float("nan"), "duration_s = nan, allowed > 0 and <= 60"),
    ],
)
def test_a_scenario_is_granted_up_to_its_longest_duration_and_not_beyond(duration_s, words):
    wanted = ModeRequest(Mode.EXCITE, duration_s=duration_s, scenario="friction")

    assert ask(wanted, patient_configured=True) == words


def test_an_unknown_scenario_is_answered_with_those_that_are_configured():
    wanted = ModeRequest(Mode.EXCITE, duration_s=1.0, scenario="nope")

    assert ask(wanted) == "scenario = 'nope', configured are: friction, paper"
