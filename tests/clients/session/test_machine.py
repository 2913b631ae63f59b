"""The state machine over all states and inputs, and its rules one by one."""

import itertools
from pathlib import Path

import pytest
from gaitd_client import Cause, Mode, RefusalCode, Stage
from gaitd_client.wire import Refusal
from gaitd_names import Untested
from gaitd_session.advice import Advice, Failure, Why, refusal_of
from gaitd_session.machine import (
    ACTIVE,
    ANNOUNCE_S,
    AT_REST,
    LATE_S,
    LEFT_MIN_S,
    NOT_PASSED,
    OFF_RETRY_S,
    OFF_SETTLE_S,
    RESULT_LATE_S,
    SELF_TEST_LATE_S,
    TABLE,
    WHY_OF,
    Answer,
    Button,
    Event,
    Inputs,
    Phase,
    RequestKind,
    TrainerState,
    begin,
    step,
)
from gaitd_session.plan import BlockKind
from gaitd_session.profile import parse_profile
from gaitd_session.steps import Result, StrideShare
from gaitd_session.view import ADVICE_ON_UNTESTED, view_of
from msgspec.structs import replace
from training import PASSIVE, PROFILE, profile

ENABLED = {Mode.HOLD, Mode.GAIT, Mode.SELF_TEST, Mode.TORQUE, Mode.HAND_GUIDING}
MOTION = {RequestKind.SELF_TEST, RequestKind.GAIT}
TICK_S = 0.05


def refused(code, **values):
    return Refusal(code=code, subject=None, values=values, said="")


DUE = refused(RefusalCode.SELF_TEST_DUE, self_test_due="too_old")
BUSY = refused(RefusalCode.BUSY, open_request="disable")
DONE = "done"
"""In place of a refusal."""


def trainer(mode, stage=None, *, hand=True, cause=Cause.NONE, boot="a", power=None):
    has_power = mode in ENABLED if power is None else power
    return TrainerState(boot, mode, mode in ENABLED, stage, cause, has_power, hand)


READY = trainer(Mode.READY)
OPEN = trainer(Mode.READY, hand=False)
HOLD = trainer(Mode.HOLD)
TESTING = trainer(Mode.SELF_TEST, Stage.PLAYING)
ANNOUNCING = trainer(Mode.GAIT, Stage.ANNOUNCING)
PLAYING = trainer(Mode.GAIT, Stage.PLAYING)
FAULT = trainer(Mode.FAULT, cause=Cause.SPASM, power=True)
TEST_PASSED = HOLD._replace(self_test_passed=True)
OFF_BY_STO = trainer(Mode.FAULT, cause=Cause.STO_ACTIVE)


class Run:
    """A session in which every request is done at once, unless a test answers otherwise."""

    def __init__(self, plan=None, *, self_test_due=False):
        self.state = begin(plan or profile(), {}, self_test_due=self_test_due)
        self.now_s = 1000.0
        self.requests = []
        self.trainer = None

    def step(self, seen, button=None, *, after_s=TICK_S, strides=(), failure=None):
        self.now_s += after_s
        self.trainer = seen
        number = self.state.request_number
        answer = Answer(number, failure) if self.state.pending or failure else None
        inputs = Inputs(seen, button, answer, strides)
        self.state, request = step(self.state, inputs, self.now_s)
        if request is not None:
            self.requests.append(request)
        return self

    def walk(self):
        """From rest into the gait of the next block."""
        self.step(READY).step(READY, Button.START).step(HOLD)
        self.step(HOLD, after_s=ANNOUNCE_S).step(ANNOUNCING).step(PLAYING)
        assert self.state.phase is Phase.WALKING
        return self

    @property
    def kinds(self):
        return [request.kind for request in self.requests]

    @property
    def view(self):
        return view_of(self.state, self.trainer, self.now_s)


# --- every state and input --------------------------------------------------------------------

SEEN = (
    None,
    READY,
    OPEN,
    HOLD,
    TEST_PASSED,
    trainer(Mode.HOLD, hand=False),
    trainer(Mode.HOLD, hand=None),
    trainer(Mode.HOLD, boot="b"),
    TESTING,
    ANNOUNCING,
    PLAYING,
    trainer(Mode.GAIT, Stage.PLAYING, hand=False),
    trainer(Mode.GAIT, Stage.PLAYING, boot="b"),
    trainer("a mode of a later version"),
    trainer(Mode.OFF),
    trainer(Mode.STOPPING, cause=Cause.HAND_SWITCH_OPEN),
    FAULT,
    OFF_BY_STO,
)
ANSWERS = (DONE, DUE)
STEPS_S = (TICK_S, SELF_TEST_LATE_S + 1)
INPUTS = tuple(itertools.product(SEEN, (None, *Button), STEPS_S, (None, *ANSWERS)))
WITHOUT_ANSWER = tuple(one for one in INPUTS if one[-1] is None)


def kind_of(state, now_s):
    """What tells two states apart, without the time itself."""
    return (
        state.phase,
        state.returns_to,
        state.may_follow,
        state.block_index,
        state.playing_since_s is None,
        state.self_test_due,
        state.boot_id,
        state.pending,
        state.off_since_s is None,
        state.test_ended_s is None,
        now_s < state.rest_until_s,
    )


def reachable():
    """Every kind of state, with the inputs that follow it, found breadth first."""
    now_s = 1000.0
    states = [(begin(profile(), {}, self_test_due=due), now_s) for due in (True, False)]
    seen = {kind_of(*one) for one in states}
    for state, now_s in states:
        for found, button, after_s, answered in INPUTS if state.pending else WITHOUT_ANSWER:
            refusal = None if answered == DONE else answered
            answer = None if answered is None else Answer(state.request_number, refusal)
            inputs, later_s = Inputs(found, button, answer), now_s + after_s
            after, request = step(state, inputs, later_s)
            yield state, inputs, later_s, after, request
            kind = kind_of(after, later_s)
            if kind not in seen:
                seen.add(kind)
                states.append((after, later_s))


def test_no_state_and_no_input_moves_a_leg_without_hand_switch_and_start():
    visited, requested = set(), set()
    for state, inputs, now_s, after, request in reachable():
        visited.add((state.phase, after.phase))
        held = inputs.trainer is not None and inputs.trainer.hand_switch_held
        started = inputs.button is Button.START
        if request is not None:
            requested.add(request.kind)
        if request is not None and request.kind is RequestKind.ENABLE:
            # The only way into an active phase, with the one below.
            assert held
            assert started
            assert inputs.trainer.mode == Mode.READY
            assert state.phase in AT_REST
        if request is not None and request.kind is RequestKind.RESET:
            assert (held, started, state.phase) == (True, True, Phase.STOPPED)
            assert not inputs.trainer.has_power
        if request is not None and request.kind in MOTION:
            assert held
            assert inputs.trainer.mode == Mode.HOLD
            assert inputs.trainer.boot_id == state.boot_id
            assert state.phase is Phase.ANNOUNCED
            assert now_s - state.since_s >= ANNOUNCE_S
        if request is not None and request.kind is RequestKind.GAIT:
            assert not state.self_test_due
            assert request.duration_s > LEFT_MIN_S
        if state.phase not in ACTIVE and after.phase in ACTIVE:
            is_followed = state.phase is Phase.NO_SIGNAL and state.may_follow
            if request is None:
                assert is_followed
                assert inputs.trainer.mode == Mode.GAIT
            else:
                assert request.kind is RequestKind.ENABLE
        if state.phase in ACTIVE and after.phase in ACTIVE and not started:
            # What START has allowed goes on with the hand switch, the core and the signal it had;
            # a drive that has missed a cycle does not say that the switch is open.
            assert inputs.trainer.hand_switch_held is not False
            assert inputs.trainer.boot_id == state.boot_id
            assert inputs.button is None

    assert {phase for _, phase in visited} == set(Phase)
    assert requested == set(RequestKind)


def test_every_event_has_a_row_or_changes_nothing():
    for phase, row in TABLE.items():
        if phase in ACTIVE:
            assert set(row) == set(Event) - {Event.START}
            assert row[Event.OTHER] is row[Event.LET_GO] is row[Event.RESTARTED] is Phase.PAUSED
        starts = AT_REST - {Phase.FINISHED} | {Phase.STOPPED}
        assert (Event.START in row) == (phase in starts)
    assert set(TABLE) == set(Phase)


# --- rules ------------------------------------------------------------------------------------


def test_a_whole_session_is_self_test_warm_up_rest_block():
    run = Run(self_test_due=True).step(OPEN)
    assert run.view.advice is Advice.HOLD_HAND_SWITCH
    run.step(READY)
    assert run.view.buttons == (Button.START, Button.END)
    run.step(READY, Button.START).step(HOLD).step(HOLD, after_s=ANNOUNCE_S).step(TESTING)
    assert run.state.phase is Phase.SELF_TEST
    run.step(TEST_PASSED).step(HOLD, after_s=ANNOUNCE_S).step(ANNOUNCING).step(PLAYING)
    assert (run.view.block.kind, run.view.block_left_s) == (BlockKind.WARM_UP, 10.0)
    run.step(HOLD, after_s=12.0)
    assert (run.state.phase, run.view.advice) == (Phase.REST, Advice.WAIT)
    run.step(READY, Button.START, after_s=1.0)
    assert (run.state.phase, run.view.block_left_s) == (Phase.REST, 1.0)
    run.step(OPEN, after_s=1.0)
    assert run.view.advice is Advice.HOLD_HAND_SWITCH
    run.walk().step(HOLD, after_s=14.0).step(OPEN)

    assert run.state.phase is Phase.FINISHED
    assert (run.view.buttons, run.view.may_be_replaced) == ((), False)
    assert run.step(OPEN, after_s=OFF_SETTLE_S).view.may_be_replaced
    first, second = (request for request in run.requests if request.kind is RequestKind.GAIT)
    assert (first.cadence_hz, first.amplitude_ratio, first.duration_s) == (0.5, 0.4, 10.0)
    assert (second.amplitude_ratio, second.duration_s) == (0.6, 12.0)
    enable, disable = RequestKind.ENABLE, RequestKind.DISABLE
    gait = RequestKind.GAIT
    assert run.kinds == [enable, RequestKind.SELF_TEST, gait, disable, enable, gait, disable]


def test_a_passive_minute_comes_first_is_not_judged_and_is_repeated_whole():
    plan = parse_profile(f"{PROFILE}{PASSIVE}", Path("profile.toml"))
    run = Run(plan).walk()
    assert (run.view.block.kind, run.view.advice) == (BlockKind.PASSIVE, Advice.RELAX)
    run.step(PLAYING, strides=[StrideShare("right", 0.9)])
    assert (run.view.steps, run.view.legs[0].stride_count) == ((), 0)
    run.step(PLAYING, Button.PAUSE, after_s=30.0).step(READY, after_s=OFF_SETTLE_S).walk()

    first, again = (request for request in run.requests if request.kind is RequestKind.GAIT)
    assert (first.is_passive, first.duration_s, first.cadence_hz) == (True, 80.0, 0.25)
    assert (again.is_passive, again.duration_s) == (True, 80.0)
    run.step(HOLD, after_s=81.0)
    assert run.view.block.kind is BlockKind.WARM_UP
    run.walk()
    assert (run.requests[-1].is_passive, run.view.advice) == (False, Advice.WALK)


def test_a_pause_keeps_what_is_left_of_the_block_and_disables_until_the_drives_are_off():
    run = Run().walk().step(PLAYING, Button.PAUSE, after_s=4.0)
    assert run.kinds[-1] is RequestKind.DISABLE
    run.step(PLAYING, after_s=0.5, failure=BUSY)
    assert run.kinds.count(RequestKind.DISABLE) == 1
    run.step(PLAYING, after_s=0.6)
    assert run.kinds.count(RequestKind.DISABLE) == 2
    run.step(OPEN, after_s=5.0).walk()

    assert run.requests[-1].duration_s == pytest.approx(6.0)
    assert run.view.block.number == 1


def test_an_enable_that_takes_effect_after_a_pause_is_undone():
    run = Run().step(READY).step(READY, Button.START)
    run.state = replace(run.state, pending=RequestKind.ENABLE)
    run.now_s += 1.0
    run.state, request = step(run.state, Inputs(READY, Button.PAUSE), run.now_s)
    assert (run.state.phase, request) == (Phase.PAUSED, None)
    run.step(READY, after_s=5.0).step(HOLD)

    assert run.kinds[-1] is RequestKind.DISABLE


def test_drives_that_another_client_enables_are_disabled_by_pause_only():
    run = Run().walk().step(READY, Button.PAUSE).step(READY, after_s=5.0).step(READY, after_s=5.0)
    count = len(run.requests)
    run.step(HOLD).step(trainer(Mode.HAND_GUIDING), after_s=60.0)
    assert (len(run.requests), run.view.advice) == (count, Advice.TRAINER_IS_USED)
    run.step(HOLD, Button.PAUSE)

    assert run.kinds[count:] == [RequestKind.DISABLE]


@pytest.mark.parametrize("cause", [FAULT, trainer(Mode.STOPPING, cause=Cause.SPASM)])
def test_after_a_stop_only_start_goes_on(cause):
    run = Run().walk().step(cause)
    count = len(run.requests)
    assert (run.view.phase, run.view.cause) == (Phase.STOPPED, Cause.SPASM)
    run.step(cause, Button.START, after_s=60.0).step(trainer(Mode.OFF)).step(READY).step(READY)
    assert (run.state.phase, len(run.requests)) == (Phase.PAUSED, count)
    run.step(READY, Button.START)

    assert run.kinds[count:] == [RequestKind.ENABLE]


def test_start_resets_a_stop_without_power_and_another_start_goes_on():
    run = Run().step(OPEN).step(trainer(Mode.FAULT, hand=False, cause=Cause.STO_ACTIVE))
    assert (run.view.advice, run.view.buttons) == (Advice.PRESS_START_TO_RESET, (Button.END,))
    run.step(OFF_BY_STO)
    assert run.view.buttons == (Button.START, Button.END)
    pressed = refused(RefusalCode.STO_ACTIVE)
    run.step(OFF_BY_STO, Button.START).step(OFF_BY_STO, failure=pressed)
    assert run.view.refusal == pressed
    run.step(OFF_BY_STO, Button.START).step(READY, Button.START)
    assert run.kinds == [RequestKind.RESET] * 2
    assert run.state.phase is Phase.WAITING
    run.step(READY, Button.START)

    assert run.kinds[2:] == [RequestKind.ENABLE]


def test_a_block_that_went_on_through_a_lost_signal_is_followed_and_the_gap_does_not_count():
    run = Run().walk().step(None, after_s=2.0).step(None, after_s=1.0)
    count = len(run.requests)
    assert (run.view.phase, run.view.buttons) == (Phase.NO_SIGNAL, (Button.PAUSE, Button.END))
    run.step(PLAYING, after_s=1.0)

    assert (run.state.phase, len(run.requests)) == (Phase.WALKING, count)
    assert run.view.block_left_s == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("during", "after"),
    [
        (None, trainer(Mode.GAIT, Stage.PLAYING, boot="b")),
        (None, HOLD),
        (Button.PAUSE, PLAYING),
    ],
)
def test_after_a_lost_signal_anything_else_is_paused_and_disabled(during, after):
    run = Run().walk().step(None).step(None, during).step(after)

    assert run.state.phase is Phase.PAUSED
    assert run.kinds[-1] is RequestKind.DISABLE


@pytest.mark.parametrize("button", [Button.PAUSE, Button.END])
def test_a_button_without_a_signal_switches_off_at_once_and_until_it_is_seen(button):
    run = Run().walk()
    count = len(run.requests)
    run.step(None).step(None, after_s=OFF_RETRY_S)
    assert len(run.requests) == count
    run.step(None, button)
    assert run.kinds[count:] == [RequestKind.DISABLE]
    run.step(None, after_s=OFF_RETRY_S, failure=refusal_of(Failure.NO_ANSWER)).step(PLAYING)

    assert run.state.phase is (Phase.PAUSED if button is Button.PAUSE else Phase.FINISHED)
    assert run.kinds[count:] == [RequestKind.DISABLE] * 2


def test_a_self_test_that_another_client_ended_is_still_due():
    run = Run(self_test_due=True).step(READY).step(READY, Button.START).step(HOLD)
    run.step(HOLD, after_s=ANNOUNCE_S).step(TESTING).step(HOLD).step(
        HOLD, after_s=RESULT_LATE_S / 2
    )
    assert run.state.phase is Phase.SELF_TEST
    run.step(HOLD, after_s=RESULT_LATE_S)

    assert (run.state.phase, run.state.self_test_due) == (Phase.PAUSED, True)
    assert run.kinds[-1] is RequestKind.DISABLE
    assert run.step(READY, after_s=5.0).view.advice is Advice.TRY_AGAIN_OR_CALL_THERAPIST
    assert run.view.refusal == NOT_PASSED


def test_a_lost_signal_in_a_rest_changes_nothing_about_it():
    run = Run().walk().step(READY, after_s=11.0).step(None).step(OPEN)

    assert run.state.phase is Phase.REST
    assert run.view.block_left_s == pytest.approx(2.0 - 2 * TICK_S)


def test_a_gait_that_is_refused_for_want_of_a_self_test_makes_one_due():
    run = Run().step(READY).step(READY, Button.START).step(HOLD).step(HOLD, after_s=ANNOUNCE_S)
    run.step(HOLD, failure=DUE)
    assert (run.state.phase, run.kinds[-1]) == (Phase.PAUSED, RequestKind.DISABLE)
    assert run.view.refusal == DUE
    run.step(READY).step(READY, Button.START).step(HOLD).step(HOLD, after_s=ANNOUNCE_S)

    assert run.kinds[-1] is RequestKind.SELF_TEST


@pytest.mark.parametrize(
    ("refusal", "advice"),
    [
        (
            refused(RefusalCode.INPUT_UNTESTED, untested=Untested.STO_ACTIVE),
            Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT,
        ),
        (
            refused(RefusalCode.INPUT_UNTESTED, untested=Untested.HAND_SWITCH_OPEN),
            Advice.LET_GO_AND_HOLD_HAND_SWITCH,
        ),
        (refused(RefusalCode.STO_ACTIVE), Advice.RELEASE_EMERGENCY_STOP),
        (refused(RefusalCode.LEG_MOVES), Advice.TRY_AGAIN_OR_CALL_THERAPIST),
        (refused("of_a_later_version"), Advice.TRY_AGAIN_OR_CALL_THERAPIST),
    ],
)
def test_a_refused_enable_says_what_the_patient_can_do(refusal, advice):
    run = Run().step(READY).step(READY, Button.START).step(READY, failure=refusal)
    run.step(READY, after_s=5.0)

    assert (run.state.phase, run.view.advice) == (Phase.PAUSED, advice)
    assert run.view.refusal == refusal


def test_what_does_not_come_in_time_is_given_up():
    run = Run().step(READY).step(READY, Button.START).step(READY, after_s=LATE_S)

    assert run.state.phase is Phase.PAUSED


def test_an_old_answer_and_a_start_that_is_not_offered_do_nothing():
    run = Run().step(READY).step(READY, Button.START).step(READY, Button.START)
    assert run.state.phase is Phase.ENABLING
    run = Run().walk()
    number = run.state.request_number
    after, request = step(run.state, Inputs(PLAYING, None, Answer(number - 1, BUSY)), run.now_s)
    assert (after.phase, request) == (Phase.WALKING, None)
    run.step(PLAYING, Button.START)

    assert run.state.phase is Phase.WALKING


def test_the_first_block_proposes_the_band_and_a_paused_block_keeps_its_own():
    shares = [StrideShare("right", share) for share in (0.3, None, 0.5, 0.31, 0.5, 0.5, 0.5)]
    run = Run().walk().step(PLAYING, strides=[*shares, StrideShare("left", 0.9)])
    leg = run.view.legs[0]
    assert (leg.stride_count, leg.valid_count, leg.share_ratio) == (7, 6, 0.5)
    assert leg.band_low_ratio == pytest.approx(0.25)
    # Of the last three: 0.3, unknown, 0.4, 0.405, then 0.5 for ever.
    assert [step.result for step in run.view.steps] == [
        *(Result.WITHIN, Result.UNKNOWN),
        *[Result.ABOVE] * 5,
    ]
    assert (leg.in_band_count, run.view.row_count, run.view.best_row_count) == (1, 0, 1)
    run.step(READY, Button.PAUSE).walk()
    assert run.view.legs[0].stride_count == 7
    run.step(READY, after_s=12.0)
    assert run.view.legs[0] == leg
    walked_s = run.view.session_walked_s
    run.step(READY, after_s=3.0).walk()
    leg = run.view.legs[0]

    assert (leg.stride_count, leg.share_ratio, run.view.steps) == (0, None, ())
    assert leg.band_low_ratio == pytest.approx(0.47)
    run.step(PLAYING, strides=[StrideShare("right", 0.5)] * 3, after_s=5.0)
    leg = run.view.legs[0]
    assert (leg.stride_count, leg.session_valid_count, leg.session_in_band_count) == (3, 9, 4)
    assert (run.view.row_count, run.view.best_row_count) == (3, 3)
    assert run.view.session_share_ratio == pytest.approx((0.3 + 0.31 + 7 * 0.5) / 9)
    assert run.view.session_walked_s == pytest.approx(walked_s + 5.0, abs=3 * TICK_S)


def test_each_input_that_was_not_seen_to_act_has_its_advice():
    assert set(Untested) <= set(ADVICE_ON_UNTESTED)


def test_whatever_ends_a_start_early_is_told_by_a_reason_a_stop_a_refusal_or_a_button():
    tells_itself = {Event.STOPPED, Event.FAILED}
    tells_itself |= {Event.PAUSE, Event.END, Event.ANNOUNCE_OVER}
    for phase in ACTIVE:
        ends = {event for event, after in TABLE[phase].items() if after not in ACTIVE}
        assert ends - tells_itself <= set(WHY_OF)
    assert set(WHY_OF.values()) | {Why.LATE_HERE} == set(Why)
