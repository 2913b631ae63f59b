"""What the mode table as a whole keeps to, and every guard at its limits and beside them."""

from dataclasses import FrozenInstanceError, replace

import msgspec
import pytest
from gaitd_names import Doubt, Mode, RefusalCode, RequestKind, SelfTestDue, Trigger, Untested
from safety_inputs import ALL_WELL

from daemon.core.modes.table import (
    NO_RULES,
    TRANSITIONS,
    refusal,
    rules_of,
    trigger_of,
)
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal

NOTHING_WELL = replace(
    ALL_WELL,
    gateway_alive=False,
    at_rest=False,
    hand_switch_closed=False,
    hand_switch_known=True,
    sto_released=False,
    unreferenced=(("right/hip", Doubt.NOT_HOMED),),
    outside=("right/slide",),
    drives_powered=False,
    patient_configured=True,
)
EXERCISES = {
    Mode.GAIT: Trigger.TO_GAIT,
    Mode.TORQUE: Trigger.TO_TORQUE,
    Mode.EXCITE: Trigger.TO_EXCITE,
    Mode.HAND_GUIDING: Trigger.TO_HAND_GUIDING,
    Mode.SELF_TEST: Trigger.TO_SELF_TEST,
}
PREPARATIONS = {Mode.REFERENCE: Trigger.TO_REFERENCE, Mode.COMMISSION: Trigger.TO_COMMISSION}
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
    assert rows_of(mode)[Trigger.TO_HOLD] == Mode.HOLD
    assert rows_of(mode)[Trigger.EXERCISE_OVER] == Mode.HOLD
    assert set(rows_of(mode).values()) == {Mode.HOLD, Mode.STOPPING}


def test_assist_that_lapses_ends_torque_and_gait_in_hold_and_is_no_matter_elsewhere():
    lapses = {
        mode: to for (mode, event), to in TRANSITIONS.items() if event is Trigger.LEASE_LAPSED
    }

    assert lapses == {Mode.GAIT: Mode.HOLD, Mode.TORQUE: Mode.HOLD}


def test_a_stop_that_was_latched_before_this_start_ends_bring_up_in_fault():
    assert rows_of(Mode.BRINGING_UP)[Trigger.STILL_LATCHED] == Mode.FAULT


@pytest.mark.parametrize("mode", PREPARATIONS)
def test_one_axis_alone_is_moved_out_of_ready_and_stops_however_it_ends(mode):
    assert rows_into(mode) == {(Mode.READY, PREPARATIONS[mode])}
    assert rows_of(mode) == dict.fromkeys(
        (Trigger.EXERCISE_OVER, Trigger.DISABLE, Trigger.STOP), Mode.STOPPING
    )


def test_holding_begins_by_enable_and_is_what_every_exercise_falls_back_to():
    assert rows_of(Mode.READY)[Trigger.ENABLE] == Mode.HOLD
    assert {mode for mode, _ in rows_into(Mode.HOLD)} == {Mode.READY, *EXERCISES}


def test_a_stop_ends_in_ready_if_it_was_asked_for_and_in_fault_by_a_verdict():
    assert rows_of(Mode.STOPPING) == {
        Trigger.AT_REST_WELL: Mode.READY,
        Trigger.AT_REST_STOPPED: Mode.FAULT,
    }


def test_ready_is_reached_by_a_whole_bring_up_and_by_a_stop_as_asked_and_by_nothing_else():
    assert rows_into(Mode.READY) == {
        (Mode.BRINGING_UP, Trigger.BRING_UP_DONE),
        (Mode.STOPPING, Trigger.AT_REST_WELL),
    }


def test_drives_are_brought_up_from_off_alone():
    assert rows_of(Mode.OFF) == {Trigger.BRING_UP_BEGUN: Mode.BRINGING_UP}
    assert rows_into(Mode.BRINGING_UP) == {(Mode.OFF, Trigger.BRING_UP_BEGUN)}


@pytest.mark.parametrize("mode", [Mode.BRINGING_UP, Mode.READY])
def test_a_drive_that_is_lost_before_anything_is_enabled_is_off_and_a_faulty_one_a_fault(mode):
    assert rows_of(mode)[Trigger.DRIVES_LOST] == Mode.OFF
    assert rows_of(mode)[Trigger.DRIVE_FAULTY] == Mode.FAULT


def test_drives_get_other_limits_by_being_brought_up_anew():
    assert rows_of(Mode.READY)[Trigger.RESET] == Mode.OFF
    assert rows_of(Mode.READY)[Trigger.BRING_UP_RESTARTED] == Mode.OFF


@pytest.mark.parametrize(
    ("kind", "event"),
    [
        (RequestKind.ENABLE, Trigger.ENABLE),
        (RequestKind.DISABLE, Trigger.DISABLE),
        (RequestKind.RESET, Trigger.RESET),
    ],
)
def test_a_request_asks_for_its_event_whatever_mode_it_names(kind, event):
    for mode in Mode:
        assert trigger_of(kind, ModeRequest(mode)) is event


def test_a_mode_that_the_core_enters_by_itself_has_no_rules():
    by_itself = [mode for mode in Mode if rules_of(mode) is NO_RULES]

    assert by_itself == [Mode.OFF, Mode.BRINGING_UP, Mode.READY, Mode.STOPPING, Mode.FAULT]


def test_one_can_ask_for_hold_for_an_exercise_for_a_preparation_and_for_no_other_mode():
    wanted = {Mode.HOLD: Trigger.TO_HOLD} | EXERCISES | PREPARATIONS

    for mode in Mode:
        assert trigger_of(RequestKind.MODE, ModeRequest(mode)) is wanted.get(mode)


def test_what_the_guards_look_at_is_not_altered_by_looking():
    with pytest.raises(FrozenInstanceError):
        ALL_WELL.at_rest = False  # type: ignore[misc]


# --- the guards -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode.active])
def test_disable_needs_nothing_to_be_well(mode):
    assert refusal(RequestKind.DISABLE, ModeRequest(), replace(NOTHING_WELL, mode=mode)) is None


@pytest.mark.parametrize("mode", EXERCISES)
def test_going_back_to_hold_needs_nothing_to_be_well(mode):
    hold = ModeRequest(Mode.HOLD)

    assert refusal(RequestKind.MODE, hold, replace(NOTHING_WELL, mode=mode)) is None


@pytest.mark.parametrize("mode", EXERCISES)
def test_no_exercise_begins_while_the_drives_do_not_hold_yet(mode):
    refused = ask(mode, drives_powered=False, lease_held=True)

    assert refused == Refusal(RefusalCode.NOT_HOLDING_YET)


def test_torque_is_for_whoever_holds_the_lease():
    assert ask(Mode.TORQUE, lease_held=True) is None
    assert ask(Mode.TORQUE, lease_held=False) == Refusal(RefusalCode.LEASE_NEEDED)


MOVING = {Mode.GAIT: GAIT, Mode.TORQUE: ModeRequest(Mode.TORQUE)} | {
    Mode.EXCITE: ModeRequest(Mode.EXCITE, duration_s=1.0, scenario="friction")
}


@pytest.mark.parametrize("why", [SelfTestDue.FAILED, SelfTestDue.TOO_OLD])
@pytest.mark.parametrize("mode", EXERCISES)
def test_before_the_test_of_the_day_no_leg_is_moved_but_by_hand_and_by_the_test(mode, why):
    answer = ask(MOVING.get(mode, mode), lease_held=True, self_test_due=why)

    due = Refusal(RefusalCode.SELF_TEST_DUE, values=(why,))
    assert answer == (due if mode in MOVING else None)


def test_enable_names_what_was_not_seen_to_act_today():
    states = (("right/hip", Untested.STO_ACTIVE), ("right/slide", Untested.HAND_SWITCH_OPEN))
    now = replace(ALL_WELL, inputs_untested=states)

    answer = refusal(RequestKind.ENABLE, ModeRequest(), now)

    assert answer == Refusal(RefusalCode.INPUT_UNTESTED, "right/hip", (Untested.STO_ACTIVE,))


BOTH = ("right/hip", "right/slide")


@pytest.mark.parametrize(
    ("change", "code", "values"),
    [
        ({"unproven": BOTH}, RefusalCode.SIGN_NOT_PROVEN, ()),
        (
            {"unreferenced": tuple((axis, Doubt.NOT_HOMED) for axis in BOTH)},
            RefusalCode.NOT_REFERENCED,
            (Doubt.NOT_HOMED,),
        ),
        ({"outside": BOTH}, RefusalCode.OUTSIDE_RANGE, ()),
    ],
)
def test_enable_names_the_first_axis_that_is_in_the_way(change, code, values):
    answer = refusal(RequestKind.ENABLE, ModeRequest(), replace(ALL_WELL, **change))

    assert answer == Refusal(code, "right/hip", values)


@pytest.mark.parametrize("mode", PREPARATIONS)
@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({}, None),
        ({"patient_configured": True}, RefusalCode.PATIENT_CONFIGURED),
        ({"gateway_alive": False}, RefusalCode.GATEWAY_SILENT),
        ({"hand_switch_closed": False}, RefusalCode.HAND_SWITCH_OPEN),
        ({"sto_released": False}, RefusalCode.STO_ACTIVE),
        ({"at_rest": False}, RefusalCode.LEG_MOVES),
    ],
)
def test_one_axis_alone_is_moved_in_the_empty_machine_at_rest_with_the_switch_held(
    mode, change, code
):
    answer = refusal(RequestKind.MODE, ModeRequest(mode), replace(ALL_WELL, **change))

    assert answer == (None if code is None else Refusal(code))


@pytest.mark.parametrize("mode", PREPARATIONS)
def test_what_a_witness_saw_is_taken_down_without_any_motion_and_so_without_a_guard(mode):
    seen = ModeRequest(mode, witnessed=True)

    assert refusal(RequestKind.MODE, seen, replace(NOTHING_WELL, mode=Mode.READY)) is None


@pytest.mark.parametrize("key", ["at_rest", "hand_switch_closed", "sto_released"])
def test_a_reset_without_a_fault_only_brings_up_anew_and_waits_for_nothing(key):
    ready = replace(ALL_WELL, mode=Mode.READY, **{key: False})

    assert refusal(RequestKind.RESET, ModeRequest(), ready) is None


TINY = 5e-324
"""The least number above zero."""


@pytest.mark.parametrize(
    ("key", "code", "granted", "refused"),
    [
        (
            *("cadence_hz", RefusalCode.CADENCE_OUT_OF_RANGE),
            (0.02, 0.25, 0.5),
            (-0.25, 0.0, 0.01999, 0.5000001, float("inf"), float("nan")),
        ),
        (
            *("amplitude_ratio", RefusalCode.AMPLITUDE_OUT_OF_RANGE),
            (TINY, 0.5, 1.0),
            (-0.5, 0.0, 1.0000001, float("nan")),
        ),
        (
            *("duration_s", RefusalCode.DURATION_OUT_OF_RANGE),
            (TINY, 0.5, 3600.0),
            (-1.0, 0.0, 3600.001, float("inf"), float("nan")),
        ),
    ],
)
def test_a_gait_is_granted_up_to_each_limit_and_not_beyond(key, code, granted, refused):
    for value in granted:
        assert ask(msgspec.structs.replace(GAIT, **{key: value})) is None
    for value in refused:
        answer = ask(msgspec.structs.replace(GAIT, **{key: value}))
        assert answer.code is code
        assert answer.values[0] == pytest.approx(value, nan_ok=True)


@pytest.mark.parametrize("duration_s", [TINY, 0.5, 60.0])
def test_a_scenario_is_granted_up_to_its_longest_duration(duration_s):
    wanted = ModeRequest(Mode.EXCITE, duration_s=duration_s, scenario="friction")

    assert ask(wanted, patient_configured=True) is None


@pytest.mark.parametrize("duration_s", [-1.0, 0.0, 60.001, float("nan")])
def test_a_scenario_is_refused_beyond_its_longest_duration(duration_s):
    wanted = ModeRequest(Mode.EXCITE, duration_s=duration_s, scenario="friction")

    answer = ask(wanted, patient_configured=True)

    assert answer.code is RefusalCode.DURATION_OUT_OF_RANGE
    assert answer.values == pytest.approx((duration_s, 0.0, 60.0), nan_ok=True)


def test_an_unknown_scenario_is_answered_with_those_that_are_configured():
    wanted = ModeRequest(Mode.EXCITE, duration_s=1.0, scenario="nope")

    assert ask(wanted) == Refusal(RefusalCode.NO_SUCH_SCENARIO, said="friction, paper")
