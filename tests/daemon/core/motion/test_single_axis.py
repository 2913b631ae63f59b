"""Homing and sign tests as pure plans: what one cycle shows, and what comes of it."""

from dataclasses import replace
from itertools import pairwise

import pytest
from gaitd_names import AxisStep, Failure, Stage

from daemon.core.exercises.homing import BEGIN_CYCLES, Homing
from daemon.core.exercises.sign_test import SignTest
from daemon.core.exercises.single_axis import (
    OVER,
    AxisSample,
    AxisStart,
    HomingRules,
    PushRules,
)
from drives.signals import HomingState

RULES = PushRules(effort_max_si=12.0, effort_rate_si_per_s=6.0, motion_si=0.035)
LIMIT_CYCLES = 4000
RESTS = AxisSample(ready=True, homing=HomingState.NOT_STARTED, position_si=0.2, at_rest=True)


def start(timeout_cycles=100):
    rules = HomingRules(30.0, 0.3, timeout_cycles)
    return AxisStart("right/hip", RULES, rules, True, True, cycle=0, period_s=0.01)


def homing(*states, timeout_cycles=1000):
    """Play a homing through states that the drive shows, one a cycle."""
    run = Homing.begin(start(timeout_cycles)).enabling()
    for state in states:
        run = run.advance(RESTS._replace(homing=state))
        if run.step in OVER:
            break
    return run


S = HomingState


def test_a_homing_is_done_when_home_is_attained_and_reached():
    run = homing(S.NOT_STARTED, S.NOT_STARTED, S.IN_PROGRESS, S.IN_PROGRESS, S.ATTAINED, S.DONE)

    assert run.step is AxisStep.DONE


def test_a_home_that_was_already_shown_is_not_believed_until_the_drive_has_homed_again():
    stale = [S.DONE] * (BEGIN_CYCLES + 2)

    assert homing(*stale).step is AxisStep.FAILED
    assert homing(S.DONE, S.DONE, S.IN_PROGRESS, S.DONE).step is AxisStep.DONE


@pytest.mark.parametrize("error", [S.FAILED, S.FAILED_MOVING])
def test_a_homing_error_of_the_drive_fails(error):
    run = homing(S.NOT_STARTED, S.IN_PROGRESS, error)

    assert run.step is AxisStep.FAILED
    assert run.why is Failure.HOMING_ERROR


def test_a_drive_that_does_not_begin_or_gives_up_fails():
    assert homing(*[S.NOT_STARTED] * 40).why is Failure.DOES_NOT_HOME
    gave_up = [S.NOT_STARTED, *[S.IN_PROGRESS] * 30, S.NOT_STARTED]
    assert homing(*gave_up).why is Failure.DOES_NOT_HOME


def test_a_homing_that_takes_too_long_fails():
    run = homing(S.NOT_STARTED, *[S.IN_PROGRESS] * 60, timeout_cycles=50)

    assert run.step is AxisStep.FAILED
    assert run.why is Failure.HOME_NOT_FOUND


def test_nothing_begins_before_the_axis_is_enabled_in_its_mode():
    run = Homing.begin(start()).enabling()

    waiting = run.advance(RESTS._replace(ready=False, homing=S.DONE))

    assert waiting.step is AxisStep.ENABLING
    assert not waiting.searching


def played(mobility_si_per_n, breakaway_si=7.0):
    """A joint that moves by so much per effort above its friction, each cycle; the ended test."""
    test, position_si, efforts = SignTest.begin(start()).enabling(), 0.2, []
    for _ in range(LIMIT_CYCLES):
        beyond_si = max(abs(test.effort_si) - breakaway_si, 0.0)
        step_si = mobility_si_per_n * beyond_si * (1 if test.effort_si > 0 else -1)
        position_si += step_si
        seen = RESTS._replace(position_si=position_si, at_rest=step_si == 0.0)
        test = test.advance(seen)
        efforts.append(test.effort_si)
        if test.step in OVER:
            return test, efforts
    raise AssertionError(f"never over: {test}")


def test_an_axis_that_follows_its_torque_passes():
    test, efforts = played(0.01)

    assert test.step is AxisStep.DONE
    assert test.moved_forth_si >= 0.035 >= -0.035 >= test.moved_back_si
    assert max(map(abs, efforts)) <= RULES.effort_max_si


def test_an_axis_that_moves_against_its_torque_fails_after_a_little_motion():
    test, efforts = played(-0.01)

    assert test.step is AxisStep.FAILED
    assert test.why is Failure.MOVES_AGAINST_TORQUE
    assert max(map(abs, efforts)) < 9.0


def test_an_axis_that_does_not_move_fails_at_its_bound():
    test, efforts = played(0.0)

    assert test.step is AxisStep.FAILED
    assert test.why is Failure.DOES_NOT_MOVE
    assert max(map(abs, efforts)) == RULES.effort_max_si


def test_effort_rises_by_its_rate_and_is_nothing_between_the_pushes():
    _, efforts = played(0.01)
    rises = [b - a for a, b in pairwise(efforts) if b > a > 0]

    assert rises == pytest.approx([0.06] * len(rises))
    assert efforts.count(0.0) > 40


def test_an_axis_at_its_end_stop_that_moves_the_other_way_passes():
    test = SignTest.begin(start()).enabling()
    position_si = 0.2
    for _ in range(LIMIT_CYCLES):
        if test.effort_si < -8.0:
            position_si -= 0.01
        test = test.advance(RESTS._replace(position_si=position_si))
        if test.step in OVER:
            break

    assert test.step is AxisStep.DONE


def test_an_axis_that_never_rests_fails():
    test = replace(SignTest.begin(start()).enabling(), step=AxisStep.RESTING)
    for _ in range(LIMIT_CYCLES):
        test = test.advance(RESTS._replace(at_rest=False))
        if test.step in OVER:
            break

    assert test.step is AxisStep.FAILED
    assert test.why is Failure.KEEPS_MOVING


def test_a_home_that_was_attained_at_another_time_is_not_believed_either():
    stale = [S.ATTAINED, S.ATTAINED, *[S.DONE] * (BEGIN_CYCLES + 2)]

    assert homing(*stale).step is AxisStep.FAILED
    assert homing(S.ATTAINED, S.IN_PROGRESS, S.ATTAINED, S.DONE).step is AxisStep.DONE


def test_every_step_of_a_preparation_is_a_stage_that_a_program_can_read():
    runs = {step: replace(SignTest.begin(start()), step=step) for step in AxisStep}

    assert {step for step, run in runs.items() if run.stage is Stage.OVER} == OVER
