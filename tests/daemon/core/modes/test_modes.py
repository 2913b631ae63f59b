"""The mode table and its guards, without any drive."""

from dataclasses import replace

import pytest
from gaitd_names import Doubt, Mode, RefusalCode, RequestKind, Trigger
from safety_inputs import ALL_WELL

from daemon.core.modes.table import (
    TRANSITIONS,
    IllegalTransitionError,
    next_mode,
    refusal,
)
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal

GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=10.0)
PAPER = ModeRequest(Mode.EXCITE, duration_s=25.0, scenario="paper")
ACTIVE = [mode for mode in Mode if mode.active]
CADENCE = RefusalCode.CADENCE_OUT_OF_RANGE
AMPLITUDE = RefusalCode.AMPLITUDE_OUT_OF_RANGE
DURATION = RefusalCode.DURATION_OUT_OF_RANGE
NOT_HOLDING = Refusal(RefusalCode.NOT_HOLDING_YET)


def test_an_active_mode_is_entered_from_an_inactive_one_in_ready_only_and_by_request():
    into = {(mode, event) for (mode, event), to in TRANSITIONS.items() if to.active}

    assert {pair for pair in into if not pair[0].active} == {
        (Mode.READY, Trigger.ENABLE),
        (Mode.READY, Trigger.TO_REFERENCE),
        (Mode.READY, Trigger.TO_COMMISSION),
    }


def test_every_active_mode_can_be_stopped_and_disabled():
    for mode in ACTIVE:
        assert TRANSITIONS[mode, Trigger.STOP] == Mode.STOPPING
        assert TRANSITIONS[mode, Trigger.DISABLE] == Mode.STOPPING


def test_power_that_appears_before_anything_is_enabled_is_stopped_out_of_ready_too():
    assert TRANSITIONS[Mode.READY, Trigger.STOP] == Mode.STOPPING


MOVING_UNSEEN = replace(ALL_WELL, unsampled=("right/hip", "right/slide"))


@pytest.mark.parametrize("lost", [(), ("right/hip",), ("right/hip", "right/slide")])
def test_enable_and_a_preparation_need_a_sample_of_every_axis_and_name_the_first_without(lost):
    now = replace(MOVING_UNSEEN, lost=frozenset(lost))

    for mode in (None, Mode.REFERENCE, Mode.COMMISSION):
        kind = RequestKind.ENABLE if mode is None else RequestKind.MODE
        refused = refusal(kind, ModeRequest(mode or Mode.HOLD, axis="right/hip"), now)
        assert refused == Refusal(RefusalCode.NO_SAMPLE, "right/hip")


def test_reset_needs_a_sample_of_every_axis_that_is_not_lost():
    stopped = replace(MOVING_UNSEEN, mode=Mode.FAULT)
    one_lost = replace(stopped, lost=frozenset({"right/hip"}))
    all_lost = replace(stopped, lost=frozenset(stopped.unsampled))

    def ask(now):
        return refusal(RequestKind.RESET, ModeRequest(), now)

    assert ask(stopped) == Refusal(RefusalCode.NO_SAMPLE, "right/hip")
    assert ask(one_lost) == Refusal(RefusalCode.NO_SAMPLE, "right/slide")
    assert ask(all_lost) is None
    assert ask(replace(stopped, mode=Mode.READY)) is None


def test_a_stop_by_a_verdict_is_left_by_a_reset_only():
    assert TRANSITIONS[Mode.STOPPING, Trigger.AT_REST_STOPPED] == Mode.FAULT
    assert {event for (mode, event) in TRANSITIONS if mode == Mode.FAULT} == {Trigger.RESET}
    assert TRANSITIONS[Mode.FAULT, Trigger.RESET] == Mode.OFF


def test_every_mode_can_be_reached_and_left():
    assert {mode for mode, _ in TRANSITIONS} == set(Mode)
    assert set(TRANSITIONS.values()) == set(Mode)


def test_a_transition_without_a_row_is_our_own_bug():
    with pytest.raises(IllegalTransitionError, match="no transition for ENABLE in FAULT"):
        next_mode(Mode.FAULT, Trigger.ENABLE)


def test_enable_is_accepted_when_all_is_well():
    assert refusal(RequestKind.ENABLE, ModeRequest(), ALL_WELL) is None


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"gateway_alive": False}, Refusal(RefusalCode.GATEWAY_SILENT)),
        ({"hand_switch_closed": False}, Refusal(RefusalCode.HAND_SWITCH_OPEN)),
        ({"sto_released": False}, Refusal(RefusalCode.STO_ACTIVE)),
        (
            {"unreferenced": (("right/hip", Doubt.REBOOTED),)},
            Refusal(RefusalCode.NOT_REFERENCED, "right/hip", (Doubt.REBOOTED,)),
        ),
        ({"at_rest": False}, Refusal(RefusalCode.LEG_MOVES)),
        ({"outside": ("right/slide",)}, Refusal(RefusalCode.OUTSIDE_RANGE, "right/slide")),
        *(
            (
                {"mode": mode},
                Refusal(RefusalCode.NOT_IN_THIS_MODE, values=(Trigger.ENABLE, mode)),
            )
            for mode in (Mode.FAULT, Mode.OFF, Mode.HOLD)
        ),
    ],
)
def test_enable_is_refused_with_the_reason(change, expected):
    assert refusal(RequestKind.ENABLE, ModeRequest(), replace(ALL_WELL, **change)) == expected


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"at_rest": False}, RefusalCode.LEG_MOVES),
        ({"hand_switch_closed": False}, RefusalCode.HAND_SWITCH_OPEN),
        ({"sto_released": False}, RefusalCode.STO_ACTIVE),
    ],
)
def test_reset_of_a_fault_is_refused_while_its_cause_is_there(change, code):
    fault = replace(ALL_WELL, mode=Mode.FAULT)

    refused = refusal(RequestKind.RESET, ModeRequest(), replace(fault, **change))

    assert refusal(RequestKind.RESET, ModeRequest(), fault) is None
    assert refused == Refusal(code)


@pytest.mark.parametrize(
    ("wanted", "code", "values"),
    [
        (ModeRequest(Mode.GAIT, 0.6, 1.0, 10.0), CADENCE, (0.6, 0.02, 0.5)),
        (ModeRequest(Mode.GAIT, 0.0, 1.0, 10.0), CADENCE, (0.0, 0.02, 0.5)),
        (ModeRequest(Mode.GAIT, 0.25, 1.1, 10.0), AMPLITUDE, (1.1, 0.0, 1.0)),
        (ModeRequest(Mode.GAIT, 0.25, 1.0, 0.0), DURATION, (0.0, 0.0, 3600.0)),
        (ModeRequest(Mode.EXCITE, duration_s=31.0, scenario="paper"), DURATION, (31.0, 0.0, 30.0)),
        (ModeRequest(Mode.TORQUE), RefusalCode.LEASE_NEEDED, ()),
        (ModeRequest(Mode.READY), RefusalCode.NO_SUCH_MODE, (Mode.READY,)),
    ],
)
def test_a_mode_is_refused_with_value_and_range(wanted, code, values):
    hold = replace(ALL_WELL, mode=Mode.HOLD)

    assert refusal(RequestKind.MODE, wanted, hold) == Refusal(code, values=values)


@pytest.mark.parametrize("wanted", [GAIT, PAPER])
def test_a_mode_within_its_range_is_granted(wanted):
    assert refusal(RequestKind.MODE, wanted, replace(ALL_WELL, mode=Mode.HOLD)) is None


def test_no_exercise_begins_before_the_drives_hold():
    enabling = replace(ALL_WELL, mode=Mode.HOLD, drives_powered=False)

    assert refusal(RequestKind.MODE, GAIT, enabling) == NOT_HOLDING
    assert refusal(RequestKind.MODE, PAPER, enabling) == NOT_HOLDING


def test_an_artificial_disturbance_is_refused_with_a_patient():
    strapped_in = replace(ALL_WELL, mode=Mode.HOLD, patient_configured=True)

    refused = refusal(RequestKind.MODE, PAPER, strapped_in)

    assert refused == Refusal(RefusalCode.PATIENT_CONFIGURED)


def test_with_position_guidance_a_gait_is_granted_and_assist_is_refused():
    position = replace(ALL_WELL, mode=Mode.HOLD, guidance="position")

    refused = refusal(RequestKind.MODE, ModeRequest(Mode.TORQUE), position)

    assert refusal(RequestKind.MODE, GAIT, position) is None
    assert refused == Refusal(RefusalCode.GUIDANCE_BY_POSITION)


def test_an_artificial_disturbance_is_refused_while_a_controller_holds_the_lease():
    empty = replace(ALL_WELL, mode=Mode.HOLD)

    refused = refusal(RequestKind.MODE, PAPER, replace(empty, lease_held=True))

    assert refusal(RequestKind.MODE, PAPER, empty) is None
    assert refused == Refusal(RefusalCode.LEASE_HELD)
