"""One drive on its way to rest: what it is told, and what happens when it does not obey."""

import pytest
from gaitd_names import Cause, StopCategory
from hypothesis import given, settings
from hypothesis import strategies as st
from safety_inputs import FEEDBACK, JOINT, LIMITS

from daemon.core.safety import stop_sequence
from daemon.core.safety.stop_sequence import Step, StopRules
from daemon.ipc.record import Verdict
from drives.signals import PowerRequest, PowerState

RULES = StopRules(
    obey_cycles=3, standstill_cycles=5, ramp_margin_ratio=1.5, period_s=0.01, reaction_cycles=20
)
FAST = JOINT._replace(velocity_si=1.0)
STILL = JOINT._replace(velocity_si=0.0)
STOPPING_DRIVE = FEEDBACK._replace(power_state=PowerState.QUICK_STOP_ACTIVE)
OFF = FEEDBACK._replace(power_state=PowerState.SWITCH_ON_DISABLED)


def run(stop, feedback, joints, limits=LIMITS, rules=RULES):
    """The stop after one cycle for each joint, the first one cycle after it began."""
    for cycle, joint in enumerate(joints, stop.since_cycle + 1):
        stop = stop_sequence.advance(stop, feedback, joint, limits, rules, cycle)
    return stop


def verdict(cause, category, drive="right/hip"):
    return Verdict(category, cause, drive)


@pytest.mark.parametrize(
    ("cause", "category", "this", "other"),
    [
        (Cause.STOP_REQUESTED, StopCategory.NONE, Step.HOLD, Step.HOLD),
        (Cause.STOP_REQUESTED, StopCategory.S2, Step.HOLD, Step.HOLD),
        (Cause.HAND_SWITCH_OPEN, StopCategory.S1, Step.QUICK_STOP, Step.QUICK_STOP),
        (Cause.STO_ACTIVE, StopCategory.S0, Step.DISABLE, Step.DISABLE),
        (Cause.ENCODER_JUMP, StopCategory.S0, Step.DISABLE, Step.QUICK_STOP),
        (Cause.ENCODER_FROZEN, StopCategory.S0, Step.DISABLE, Step.QUICK_STOP),
        (Cause.UNREFERENCED, StopCategory.S0, Step.DISABLE, Step.QUICK_STOP),
        (Cause.DRIVE_SILENT, StopCategory.S1, Step.NMT_STOP, Step.QUICK_STOP),
        (Cause.DRIVE_REBOOTED, StopCategory.S1, Step.NMT_STOP, Step.QUICK_STOP),
    ],
)
def test_a_stop_begins_for_each_axis_as_the_design_fixes_it(cause, category, this, other):
    assert stop_sequence.first_step(verdict(cause, category), "right/hip") == this
    assert stop_sequence.first_step(verdict(cause, category), "right/slide") == other
    about_slide = verdict(cause, category, "right/slide")
    assert stop_sequence.first_step(about_slide, "right/slide") == this
    assert stop_sequence.first_step(about_slide, "right/hip") == other


@pytest.mark.parametrize("state", [s for s in PowerState if s != PowerState.OPERATION_ENABLED])
def test_a_stop_that_holds_does_not_enable_a_drive_that_is_not(state):
    drive = FEEDBACK._replace(power_state=state)

    assert stop_sequence.possible(Step.HOLD, drive) == Step.QUICK_STOP
    assert stop_sequence.possible(Step.HOLD, None) == Step.QUICK_STOP
    assert stop_sequence.possible(Step.HOLD, FEEDBACK) == Step.HOLD
    assert [stop_sequence.possible(step, drive) for step in list(Step)[1:]] == list(Step)[1:]


def test_only_a_stop_of_category_2_keeps_a_drive_enabled():
    assert stop_sequence.request(Step.HOLD) == PowerRequest.ENABLE
    assert stop_sequence.request(Step.QUICK_STOP) == PowerRequest.QUICK_STOP
    for step in (Step.DISABLE, Step.NMT_STOP, Step.SILENCE):
        assert stop_sequence.request(step) == PowerRequest.DISABLE_VOLTAGE


@pytest.mark.parametrize("obey_cycles", [3, 20])
@pytest.mark.parametrize("drive", [STOPPING_DRIVE, FEEDBACK])
def test_a_drive_whose_sign_was_judged_has_three_cycles_to_slow_down(drive, obey_cycles):
    rules = RULES._replace(obey_cycles=obey_cycles)
    begun = stop_sequence.begin(Step.QUICK_STOP, FAST, 100, must_slow=True)
    slower = JOINT._replace(velocity_si=-0.99)

    assert run(begun, drive, [FAST] * 2, rules=rules).step == Step.QUICK_STOP
    assert run(begun, drive, [slower] * 3, rules=rules).step == Step.QUICK_STOP
    escalated = run(begun, drive, [FAST] * 3, rules=rules)
    assert (escalated.step, escalated.disobeyed) == (Step.DISABLE, True)
    faster = JOINT._replace(velocity_si=1.2)
    for later in ([faster] * 3, [slower] * 3 + [FAST]):
        assert run(begun, drive, later, rules=rules._replace(obey_cycles=9)).step == Step.DISABLE
    usual = stop_sequence.begin(Step.QUICK_STOP, FAST, 100)
    assert run(usual, drive, [FAST] * 3, rules=rules).step == Step.QUICK_STOP


def test_after_its_rest_a_drive_whose_sign_was_judged_is_held_as_any_other():
    slow = JOINT._replace(velocity_si=3.1 * LIMITS.standstill_si_per_s)
    begun = stop_sequence.begin(Step.QUICK_STOP, slow, 100, must_slow=True)

    stopped = run(begun, STOPPING_DRIVE, [STILL] * 8 + [slow])

    assert (stopped.step, stopped.has_rested) == (Step.QUICK_STOP, True)


@pytest.mark.parametrize(
    ("power", "part"), [(OFF, 1.0), (STOPPING_DRIVE, 1.0), (STOPPING_DRIVE, 0.5)]
)
def test_a_drive_whose_sign_was_judged_may_stand_or_be_without_power(power, part):
    ratio = part * stop_sequence.RAMP_FLOOR_RATIO
    standing = JOINT._replace(velocity_si=ratio * LIMITS.standstill_si_per_s)
    joint = FAST if power is OFF else standing
    begun = stop_sequence.begin(Step.QUICK_STOP, joint, 100, must_slow=True)

    assert run(begun, power, [joint] * 4).step == Step.QUICK_STOP


def test_a_drive_whose_sign_was_judged_may_not_creep():
    ratio = 1.01 * stop_sequence.RAMP_FLOOR_RATIO
    creeping = JOINT._replace(velocity_si=ratio * LIMITS.standstill_si_per_s)
    begun = stop_sequence.begin(Step.QUICK_STOP, creeping, 100, must_slow=True)

    assert run(begun, STOPPING_DRIVE, [creeping] * 3).step == Step.DISABLE


def test_a_drive_whose_sign_was_judged_is_on_its_ramp_as_any_other():
    begun = stop_sequence.begin(Step.QUICK_STOP, FAST, 100, must_slow=True)
    too_slowly = JOINT._replace(velocity_si=0.95)

    assert run(begun, STOPPING_DRIVE, [too_slowly] * 8).step == Step.DISABLE


def test_a_drive_that_follows_its_ramp_comes_to_rest_where_it_is_held():
    begun = stop_sequence.begin(Step.QUICK_STOP, FAST, 100)
    ramp = [JOINT._replace(velocity_si=max(1.0 - 0.2 * k, 0.0)) for k in range(15)]

    stopped = run(begun, STOPPING_DRIVE, ramp)

    assert stopped.step == Step.QUICK_STOP
    assert stop_sequence.is_resting(stopped, RULES)
    assert not stopped.disobeyed


def test_a_drive_that_stays_enabled_is_disabled_after_three_cycles():
    begun = stop_sequence.begin(Step.QUICK_STOP, FAST, 100)

    assert run(begun, FEEDBACK, [FAST] * 3).step == Step.QUICK_STOP
    disobedient = run(begun, FEEDBACK, [FAST] * 4)

    assert disobedient.step == Step.DISABLE
    assert disobedient.disobeyed


def test_a_drive_that_shows_the_state_and_does_not_slow_down_is_disabled():
    begun = stop_sequence.begin(Step.QUICK_STOP, FAST, 100)

    assert run(begun, STOPPING_DRIVE, [FAST] * 12).step >= Step.DISABLE


def test_a_drive_that_its_own_fault_switched_off_may_coast():
    begun = stop_sequence.begin(Step.QUICK_STOP, FAST, 100)
    faulty = FEEDBACK._replace(power_state=PowerState.FAULT)

    assert run(begun, faulty, [FAST] * 50).step == Step.QUICK_STOP


def test_a_hold_may_take_longer_than_a_ramp_and_no_longer_than_its_grace():
    begun = stop_sequence.begin(Step.HOLD, FAST, 100)

    assert run(begun, FEEDBACK, [FAST] * stop_sequence.HOLD_GRACE_CYCLES).step == Step.HOLD
    assert run(begun, FEEDBACK, [FAST] * 2 * stop_sequence.HOLD_GRACE_CYCLES).step > Step.HOLD


def test_a_drive_that_stays_powered_is_taken_to_nmt_stop_and_then_to_silence():
    begun = stop_sequence.begin(Step.DISABLE, FAST, 100)

    assert run(begun, FEEDBACK, [FAST] * 4).step == Step.NMT_STOP
    assert run(begun, FEEDBACK, [FAST] * 8).step == Step.SILENCE
    assert run(begun, FEEDBACK, [FAST] * 80).step == Step.SILENCE


def test_a_drive_without_power_may_coast():
    begun = stop_sequence.begin(Step.DISABLE, FAST, 100)

    assert run(begun, OFF, [FAST] * 50).step == Step.DISABLE


def test_a_held_drive_that_is_pushed_away_is_disabled():
    held = run(stop_sequence.begin(Step.QUICK_STOP, STILL, 100), STOPPING_DRIVE, [STILL] * 10)
    limit = stop_sequence.HELD_SPEED_RATIO * LIMITS.standstill_si_per_s
    given_way = JOINT._replace(velocity_si=limit)
    loose = JOINT._replace(velocity_si=limit * 1.01)

    yielding = stop_sequence.advance(held, STOPPING_DRIVE, given_way, LIMITS, RULES, 111)
    pushed = stop_sequence.advance(held, STOPPING_DRIVE, loose, LIMITS, RULES, 111)

    assert yielding.step == Step.QUICK_STOP
    assert pushed.step == Step.DISABLE


def test_an_axis_with_a_brake_is_switched_off_at_rest_and_one_without_is_held():
    begun = stop_sequence.begin(Step.QUICK_STOP, STILL, 100)

    assert run(begun, STOPPING_DRIVE, [STILL] * 20).step == Step.QUICK_STOP
    braked = run(begun, STOPPING_DRIVE, [STILL] * 20, LIMITS._replace(brake=True))
    assert braked.step >= Step.DISABLE


def test_what_was_not_seen_is_neither_obeyed_nor_disobeyed():
    begun = stop_sequence.begin(Step.QUICK_STOP, FAST, 100)
    unseen = FEEDBACK._replace(fresh=False)

    assert run(begun, unseen, [FAST] * 20).step == Step.QUICK_STOP


TORQUE_FREE = {
    PowerState.NOT_READY_TO_SWITCH_ON: True,
    PowerState.SWITCH_ON_DISABLED: True,
    PowerState.READY_TO_SWITCH_ON: True,
    PowerState.SWITCHED_ON: True,
    PowerState.OPERATION_ENABLED: False,
    PowerState.QUICK_STOP_ACTIVE: False,
    PowerState.FAULT_REACTION_ACTIVE: False,
    PowerState.FAULT: True,
    PowerState.UNKNOWN: False,
}


@pytest.mark.parametrize("step", [Step.QUICK_STOP, Step.DISABLE])
@pytest.mark.parametrize("state", PowerState)
def test_only_a_state_without_torque_proves_for_ever_that_a_moving_drive_obeys(state, step):
    shown = FEEDBACK._replace(power_state=state)

    stopped = run(stop_sequence.begin(step, FAST, 100), shown, [FAST] * 60)

    assert stopped.step == (step if TORQUE_FREE[state] else Step.SILENCE)


@pytest.mark.parametrize("begun", [Step.HOLD, Step.QUICK_STOP, Step.DISABLE])
@pytest.mark.parametrize(
    ("state", "patience"), [(PowerState.UNKNOWN, 3), (PowerState.FAULT_REACTION_ACTIVE, 20)]
)
def test_a_state_that_proves_nothing_is_borne_so_long_and_over_all_steps_no_longer(
    begun, state, patience
):
    shown = FEEDBACK._replace(power_state=state)
    stop = stop_sequence.begin(begun, FAST, 100)

    assert run(stop, shown, [FAST] * patience).step == begun
    assert run(stop, shown, [FAST] * (patience + 1)).step == begun + 1
    # The next steps wait for obedience alone, not for the whole patience again.
    assert run(stop, shown, [FAST] * (patience + 1 + 4)).step == begun + 2
    proven = stop_sequence.advance(
        run(stop, shown, [FAST] * patience), OFF, FAST, LIMITS, RULES, 150
    )
    assert run(proven._replace(since_cycle=150), shown, [FAST] * patience).step == begun


def test_a_joint_that_is_not_seen_counts_as_neither_at_rest_nor_moving():
    unseen = STILL._replace(fresh=False)
    begun = run(stop_sequence.begin(Step.QUICK_STOP, STILL, 100), STOPPING_DRIVE, [STILL] * 2)

    assert run(begun, STOPPING_DRIVE, [unseen] * 30).at_rest_cycles == 2
    braked = LIMITS._replace(brake=True)
    assert run(begun, STOPPING_DRIVE, [unseen] * 30, braked).step == Step.QUICK_STOP


POWER = st.sampled_from(list(PowerState))
SPEEDS = st.floats(min_value=-3, max_value=3)


@settings(derandomize=True)
@given(
    st.sampled_from(list(Step)),
    st.lists(st.tuples(POWER, SPEEDS, st.booleans(), st.sampled_from(list(Step))), max_size=60),
)
def test_a_stop_never_goes_back_a_step(first, story):
    stop = stop_sequence.begin(first, FAST, 0)
    for cycle, (power, speed, fresh, step) in enumerate(story, 1):
        before = stop.step
        feedback = FEEDBACK._replace(power_state=power, fresh=fresh)
        joint = JOINT._replace(velocity_si=speed)
        stop = stop_sequence.harsher(stop, step, joint, cycle)
        stop = stop_sequence.advance(stop, feedback, joint, LIMITS, RULES, cycle)
        assert stop.step >= max(before, step)


@pytest.mark.parametrize(("ratio", "reached"), [(9.9, Step.QUICK_STOP), (10.1, Step.DISABLE)])
def test_a_drive_that_has_rested_is_loose_when_it_is_pushed_at_ten_times_standstill(ratio, reached):
    pushed = STILL._replace(velocity_si=ratio * LIMITS.standstill_si_per_s)
    stop = run(stop_sequence.begin(Step.QUICK_STOP, FAST, 100), STOPPING_DRIVE, [STILL] * 20)

    stop = stop_sequence.advance(stop, STOPPING_DRIVE, pushed, LIMITS, RULES, 121)

    assert stop.step == reached


@pytest.mark.parametrize(("ratio", "reached"), [(2.9, Step.QUICK_STOP), (3.1, Step.DISABLE)])
def test_a_drive_that_has_not_rested_by_the_end_of_its_ramp_may_be_three_times_standstill(
    ratio, reached
):
    slow = STILL._replace(velocity_si=ratio * LIMITS.standstill_si_per_s)

    stop = run(stop_sequence.begin(Step.QUICK_STOP, slow, 100), STOPPING_DRIVE, [slow] * 5)

    assert stop.step == reached


@pytest.mark.parametrize(
    ("ratio", "cycles", "reached"),
    [(9.9, 33, Step.HOLD), (10.1, 4, Step.QUICK_STOP), (3.1, 34, Step.QUICK_STOP)],
)
def test_the_core_s_own_hold_has_thirty_cycles_to_settle(ratio, cycles, reached):
    slow = STILL._replace(velocity_si=ratio * LIMITS.standstill_si_per_s)

    stop = run(stop_sequence.begin(Step.HOLD, STILL, 100), FEEDBACK, [slow] * cycles)

    assert stop.step == reached


@pytest.mark.parametrize("direction", [-1, 1])
@pytest.mark.parametrize("step", [Step.HOLD, Step.QUICK_STOP])
def test_the_speed_that_is_allowed_falls_along_the_ramp_to_its_floor(step, direction):
    """From a speed of 1: 1.5 times the ramp of 20 per s², and a multiple of 0.02 per s.

    A quick stop takes at least the ramp's 20 / 1.5 per s² from the speed.
    """
    begun = stop_sequence.begin(step, FAST._replace(velocity_si=-direction * 1.0), 100)
    shown = FEEDBACK if step is Step.HOLD else STOPPING_DRIVE
    first = 3 + (30 if step is Step.HOLD else 1)
    for elapsed in range(4, 60):
        ramp_s = max(elapsed - first, 0) * 0.01
        floor_ratio = 10 if step is Step.HOLD and elapsed <= first else 3
        slowest_si = 1.5 if step is Step.HOLD else 1.0 - 20.0 * ramp_s / 1.5
        allowed_si = max(min(1.5 * (1.0 - 20.0 * ramp_s), slowest_si), 0.0) + floor_ratio * 0.02
        for ratio, obeyed in ((0.999, True), (1.001, False)):
            joint = JOINT._replace(velocity_si=direction * ratio * allowed_si)
            stop = stop_sequence.advance(begun, shown, joint, LIMITS, RULES, 100 + elapsed)
            assert stop.disobeyed is not obeyed
            assert stop.step == (step if obeyed else step + 1)


@pytest.mark.parametrize(
    ("begun_si", "until_obeyed", "ramp_si"),
    [
        (1.0, [1.2, 1.6, 1.4], 1.6),
        (1.0, [0.9, 0.8, -1.3], 1.3),
        (1.0, [0.9, 0.8, 0.7], 1.0),
        (1.0, [30.0, 1.2, 1.2], 1.4),  # twice what the ramp takes in a cycle
        (1.0, [30.0, 30.0, 30.0], 2.2),
        (3.1, [3.4, 3.6, 3.5], 3.6),  # above the most that the axis may have
    ],
)
def test_the_ramp_begins_at_the_largest_speed_until_the_drive_has_to_obey(
    begun_si, until_obeyed, ramp_si
):
    begun = stop_sequence.begin(Step.QUICK_STOP, JOINT._replace(velocity_si=begun_si), 103)
    before = run(begun, STOPPING_DRIVE, [JOINT._replace(velocity_si=v) for v in until_obeyed])

    for elapsed in range(4, 30):
        loss_si = 0.2 * (elapsed - 4)
        allowed_si = 3 * 0.02 + max(min(1.5 * (ramp_si - loss_si), ramp_si - loss_si / 1.5), 0.0)
        for ratio, obeyed in ((0.999, True), (1.001, False)):
            joint = JOINT._replace(velocity_si=ratio * allowed_si)
            cycle = 103 + elapsed
            stop = stop_sequence.advance(before, STOPPING_DRIVE, joint, LIMITS, RULES, cycle)
            assert stop.disobeyed is not obeyed


@pytest.mark.parametrize("gained_si", [0.0, 0.1, 0.2])
def test_a_drive_that_lets_its_joint_coast_is_found_two_cycles_after_it_had_to_obey(gained_si):
    begun = stop_sequence.begin(Step.QUICK_STOP, FAST, 100)
    driven = [JOINT._replace(velocity_si=1.0 + gained_si * k) for k in (1, 2, 3)]

    assert run(begun, STOPPING_DRIVE, [*driven, driven[-1]]).step == Step.QUICK_STOP
    assert run(begun, STOPPING_DRIVE, [*driven, *driven[-1:] * 2]).step == Step.DISABLE


@pytest.mark.parametrize("late", [{"fresh": True}, {"fresh": False}])
def test_a_speed_that_is_too_late_or_not_seen_begins_no_ramp(late):
    begun = stop_sequence.begin(Step.QUICK_STOP, FAST, 100)
    faster = JOINT._replace(velocity_si=2.0, **late)
    seen = [FAST] * 3 if faster.fresh else [faster] * 3

    stop = run(begun, STOPPING_DRIVE, [*seen, faster])

    assert (stop.disobeyed, stop.step) == (True, Step.DISABLE)


def test_a_next_step_begins_at_its_cycle_and_speed_and_keeps_what_was_found():
    stop = stop_sequence.DriveStop(
        *(Step.QUICK_STOP, 100, 0.3), at_rest_cycles=4, has_rested=True, disobeyed=True
    )._replace(unproven_cycles=2)
    joint = JOINT._replace(velocity_si=-0.7)

    for milder in (Step.HOLD, Step.QUICK_STOP):
        assert stop_sequence.harsher(stop, milder, joint, 120) is stop
    assert stop_sequence.harsher(stop, Step.NMT_STOP, joint, 120) == stop_sequence.DriveStop(
        Step.NMT_STOP, 120, 0.7, disobeyed=True, unproven_cycles=2
    )


def test_a_brake_closes_after_standstill_without_any_disobedience():
    braked = LIMITS._replace(brake=True)
    begun = stop_sequence.begin(Step.QUICK_STOP, STILL, 100)

    waiting = run(begun, STOPPING_DRIVE, [STILL] * 4, braked)
    closed = run(begun, STOPPING_DRIVE, [STILL] * 5, braked)

    assert waiting.step == Step.QUICK_STOP
    assert closed == stop_sequence.DriveStop(Step.DISABLE, 105, 0.0)
    held = run(stop_sequence.begin(Step.HOLD, STILL, 100), FEEDBACK, [STILL] * 20, braked)
    assert held.step == Step.HOLD


@pytest.mark.parametrize("step", [Step.DISABLE, Step.NMT_STOP, Step.SILENCE])
def test_a_brake_takes_no_further_step_back(step):
    braked = LIMITS._replace(brake=True)

    stop = run(stop_sequence.begin(step, STILL, 100), OFF, [STILL] * 20, braked)

    assert (stop.step, stop.since_cycle, stop.disobeyed) == (step, 100, False)


def test_a_motion_begins_the_count_of_standstill_anew():
    begun = stop_sequence.begin(Step.QUICK_STOP, STILL, 100)
    slow = STILL._replace(velocity_si=1.5 * LIMITS.standstill_si_per_s)

    stop = run(begun, STOPPING_DRIVE, [STILL, STILL, slow])

    assert (stop.at_rest_cycles, stop.has_rested) == (0, False)
