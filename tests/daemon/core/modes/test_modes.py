"""The mode table and its guards, without any drive."""

from dataclasses import replace

import pytest
from safety_inputs import ALL_WELL

from daemon.core.modes.table import (
    TRANSITIONS,
    Event,
    IllegalTransitionError,
    next_mode,
    refusal,
)
from daemon.ipc.record import Mode, ModeRequest, RequestKind

GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=10.0)
PAPER = ModeRequest(Mode.EXCITE, duration_s=25.0, scenario="paper")
ACTIVE = [mode for mode in Mode if mode.active]


def test_an_active_mode_is_entered_from_an_inactive_one_in_ready_only_and_by_request():
    into = {(mode, event) for (mode, event), to in TRANSITIONS.items() if to.active}

    assert {pair for pair in into if not pair[0].active} == {
        (Mode.READY, Event.ENABLE),
        (Mode.READY, Event.TO_REFERENCE),
        (Mode.READY, Event.TO_COMMISSION),
    }


def test_every_active_mode_can_be_stopped_and_disabled():
    for mode in ACTIVE:
        assert TRANSITIONS[mode, Event.STOP] == Mode.STOPPING
        assert TRANSITIONS[mode, Event.DISABLE] == Mode.STOPPING


def test_power_that_appears_before_anything_is_enabled_is_stopped_out_of_ready_too():
    assert TRANSITIONS[Mode.READY, Event.STOP] == Mode.STOPPING


MOVING_UNSEEN = replace(ALL_WELL, unsampled=("right/hip", "right/slide"))


@pytest.mark.parametrize("lost", [(), ("right/hip",), ("right/hip", "right/slide")])
def test_enable_and_a_preparation_need_a_sample_of_every_axis_and_name_those_without(lost):
    now = replace(MOVING_UNSEEN, lost=frozenset(lost))

    for mode in (None, Mode.REFERENCE, Mode.COMMISSION):
        kind = RequestKind.ENABLE if mode is None else RequestKind.MODE
        refused = refusal(kind, ModeRequest(mode or Mode.HOLD, axis="right/hip"), now)
        assert "no sample of this cycle: right/hip, right/slide" in refused


def test_reset_needs_a_sample_of_every_axis_that_is_not_lost():
    stopped = replace(MOVING_UNSEEN, mode=Mode.FAULT)
    one_lost = replace(stopped, lost=frozenset({"right/hip"}))
    all_lost = replace(stopped, lost=frozenset(stopped.unsampled))

    def ask(now):
        return refusal(RequestKind.RESET, ModeRequest(), now)

    assert "right/hip, right/slide" in ask(stopped)
    assert "right/hip" not in ask(one_lost)
    assert "right/slide" in ask(one_lost)
    assert ask(all_lost) == ""
    assert ask(replace(stopped, mode=Mode.READY)) == ""


def test_a_stop_by_a_verdict_is_left_by_a_reset_only():
    assert TRANSITIONS[Mode.STOPPING, Event.AT_REST_STOPPED] == Mode.FAULT
    assert {event for (mode, event) in TRANSITIONS if mode == Mode.FAULT} == {Event.RESET}
    assert TRANSITIONS[Mode.FAULT, Event.RESET] == Mode.OFF


def test_every_mode_can_be_reached_and_left():
    assert {mode for mode, _ in TRANSITIONS} == set(Mode)
    assert set(TRANSITIONS.values()) == set(Mode)


def test_a_transition_without_a_row_is_our_own_bug():
    with pytest.raises(IllegalTransitionError, match="no transition for 'enable' in FAULT"):
        next_mode(Mode.FAULT, Event.ENABLE)


def test_enable_is_accepted_when_all_is_well():
    assert refusal(RequestKind.ENABLE, ModeRequest(), ALL_WELL) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gateway_alive": False}, "gateway"),
        ({"hand_switch_closed": False}, "hand switch is open"),
        ({"sto_released": False}, "safe torque off"),
        ({"unreferenced": ("right/hip",)}, "not referenced: right/hip"),
        ({"at_rest": False}, "moving"),
        ({"outside": ("right/slide",)}, "outside its range: right/slide"),
        ({"mode": Mode.FAULT}, "not possible in mode fault"),
        ({"mode": Mode.OFF}, "not possible in mode off"),
        ({"mode": Mode.HOLD}, "not possible in mode hold"),
    ],
)
def test_enable_is_refused_with_the_reason(change, words):
    assert words in refusal(RequestKind.ENABLE, ModeRequest(), replace(ALL_WELL, **change))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"at_rest": False}, "moving"),
        ({"hand_switch_closed": False}, "hand switch is open"),
        ({"sto_released": False}, "safe torque off"),
    ],
)
def test_reset_of_a_fault_is_refused_while_its_cause_is_there(change, words):
    fault = replace(ALL_WELL, mode=Mode.FAULT)

    assert refusal(RequestKind.RESET, ModeRequest(), fault) == ""
    assert words in refusal(RequestKind.RESET, ModeRequest(), replace(fault, **change))


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (GAIT, ""),
        (ModeRequest(Mode.GAIT, 0.6, 1.0, 10.0), "cadence_hz = 0.6, allowed 0.02 to 0.5"),
        (ModeRequest(Mode.GAIT, 0.0, 1.0, 10.0), "cadence_hz = 0"),
        (ModeRequest(Mode.GAIT, float("nan"), 1.0, 10.0), "cadence_hz = nan"),
        (ModeRequest(Mode.GAIT, 0.25, 1.1, 10.0), "amplitude_ratio = 1.1"),
        (ModeRequest(Mode.GAIT, 0.25, 1.0, 0.0), "duration_s = 0, allowed > 0 and <= 3600"),
        (ModeRequest(Mode.EXCITE, duration_s=1.0, scenario="nope"), "configured are: friction"),
        (ModeRequest(Mode.EXCITE, duration_s=31.0, scenario="paper"), "allowed > 0 and <= 30"),
        (PAPER, ""),
        (ModeRequest(Mode.TORQUE), "needs a lease"),
        (ModeRequest(Mode.READY), "not a mode that can be asked for"),
    ],
)
def test_a_mode_is_granted_or_refused_with_key_value_and_range(wanted, words):
    hold = replace(ALL_WELL, mode=Mode.HOLD)

    answer = refusal(RequestKind.MODE, wanted, hold)

    assert answer == words if not words else words in answer


def test_no_exercise_begins_before_the_drives_hold():
    enabling = replace(ALL_WELL, mode=Mode.HOLD, drives_powered=False)

    assert refusal(RequestKind.MODE, GAIT, enabling) == "the drives are not holding yet"
    assert refusal(RequestKind.MODE, PAPER, enabling) == "the drives are not holding yet"


def test_an_artificial_disturbance_is_refused_with_a_patient():
    strapped_in = replace(ALL_WELL, mode=Mode.HOLD, patient_configured=True)

    assert "empty machine" in refusal(RequestKind.MODE, PAPER, strapped_in)


def test_with_position_guidance_a_gait_is_granted_and_assist_is_refused():
    position = replace(ALL_WELL, mode=Mode.HOLD, guidance="position")

    assert refusal(RequestKind.MODE, GAIT, position) == ""
    assert "assist is refused" in refusal(RequestKind.MODE, ModeRequest(Mode.TORQUE), position)


def test_an_artificial_disturbance_is_refused_while_a_controller_holds_the_lease():
    empty = replace(ALL_WELL, mode=Mode.HOLD)

    assert refusal(RequestKind.MODE, PAPER, empty) == ""
    assert "lease" in refusal(RequestKind.MODE, PAPER, replace(empty, lease_held=True))
