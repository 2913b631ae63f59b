"""Homing and sign tests as pure plans: what one cycle shows, and what comes of it."""

from dataclasses import replace
from itertools import pairwise

import pytest
from gaitd_names import AxisStep, EventCode, Failure, Mode, RefusalCode, Stage
from safety_inputs import FEEDBACK, LIMITS

from daemon.core.exercises.homing import BEGIN_CYCLES, Homing
from daemon.core.exercises.sign_test import SignTest
from daemon.core.exercises.single_axis import (
    OVER,
    AxisSample,
    AxisStart,
    HomingRules,
    PushRules,
    Result,
)
from daemon.ipc.report import Refusal
from drives.signals import HomingState, OperationMode

RULES = PushRules(effort_max_si=12.0, effort_rate_si_per_s=6.0, motion_si=0.035)
SLOW_RULES = RULES._replace(effort_rate_si_per_s=0.3)
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
    for run in (Homing.begin(start()).enabling(), SignTest.begin(start()).enabling()):
        waiting = run.advance(RESTS._replace(ready=False, homing=S.DONE))

        assert (waiting.step, waiting.cycles) == (AxisStep.ENABLING, 1)
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
    stages = {step: replace(SignTest.begin(start()), step=step).stage for step in AxisStep}

    assert {step for step, stage in stages.items() if stage is Stage.OVER} == OVER
    assert stages[AxisStep.WAITING] is stages[AxisStep.ENABLING] is Stage.PREPARING
    assert stages[AxisStep.ENDING] is Stage.ENDING
    moving = AxisStep.SEARCHING, AxisStep.FORTH, AxisStep.RESTING, AxisStep.BACK
    assert {stages[step] for step in moving} == {Stage.PLAYING}


A = AxisStep


@pytest.mark.parametrize(
    ("before", "shown", "after"),
    [
        ({"step": A.WAITING}, {"homing": S.IN_PROGRESS}, {}),
        ({"step": A.DONE}, {"homing": S.IN_PROGRESS}, {}),
        ({"step": A.ENABLING}, {}, {"step": A.SEARCHING, "cycles": 0, "begun": True}),
        (
            *({"step": A.ENABLING}, {"homing": S.IN_PROGRESS}),
            {"step": A.SEARCHING, "cycles": 0, "begun": True},
        ),
        ({"step": A.ENABLING}, {"homing": S.DONE}, {"step": A.SEARCHING, "cycles": 0}),
        ({"step": A.SEARCHING, "cycles": 3}, {"homing": S.DONE}, {}),
        ({"step": A.SEARCHING, "cycles": BEGIN_CYCLES - 1}, {}, {}),
        (
            *({"step": A.SEARCHING, "cycles": BEGIN_CYCLES}, {}),
            {"step": A.FAILED, "why": Failure.DOES_NOT_HOME},
        ),
        ({"step": A.SEARCHING, "cycles": 99}, {"homing": S.IN_PROGRESS}, {"begun": True}),
        *(
            (
                *({"step": A.SEARCHING, "cycles": late}, {"homing": S.IN_PROGRESS}),
                {"step": A.FAILED, "why": Failure.HOME_NOT_FOUND},
            )
            for late in (100, 5000)
        ),
        (
            *({"step": A.SEARCHING, "begun": True}, {"homing": S.ATTAINED}),
            {"found": S.ATTAINED},
        ),
    ],
)
def test_a_homing_goes_on_by_what_a_cycle_shows(before, shown, after):
    assert not Homing.begin(start()).begun
    now = replace(Homing.begin(start()), **before)

    later = now.advance(RESTS._replace(**shown))

    assert later == replace(now, **{"cycles": now.cycles + 1, **after})


@pytest.mark.parametrize(
    ("before", "shown", "after"),
    [
        (
            *({"step": A.ENABLING, "effort_si": 3.0}, {"position_si": 0.4}),
            {"step": A.FORTH, "cycles": 0, "effort_si": 0.0, "from_si": 0.4},
        ),
        ({"step": A.FORTH, "effort_si": 3.0}, {"position_si": 0.034}, {"effort_si": 3.06}),
        ({"step": A.BACK, "effort_si": -3.0}, {"position_si": 0.034}, {"effort_si": -3.06}),
        ({"step": A.FORTH, "effort_si": 11.99}, {"position_si": 0.0}, {"effort_si": 12.0}),
        (
            *({"step": A.FORTH, "effort_si": 9.0, "rest_cycles": 5}, {"position_si": 0.035}),
            {
                **{"step": A.RESTING, "cycles": 0, "rest_cycles": 0, "effort_si": 0.0},
                **{"moved_forth_si": 0.035, "effort_forth_si": 9.0},
            },
        ),
        (
            *({"step": A.BACK, "effort_si": -9.0, "rest_cycles": 5}, {"position_si": -0.035}),
            {
                **{"step": A.ENDING, "cycles": 0, "rest_cycles": 0, "effort_si": 0.0},
                **{"moved_back_si": -0.035, "effort_back_si": -9.0},
            },
        ),
        # 200 cycles to the largest push, and half a second of it
        ({"step": A.FORTH, "cycles": 249}, {"position_si": 0.0}, {"effort_si": 0.06}),
        *(
            (
                *({"step": A.FORTH, "cycles": late}, {"position_si": 0.01}),
                {"step": A.RESTING, "cycles": 0, "moved_forth_si": 0.01},
            )
            for late in (250, 5000)
        ),
        # 12 N·m in steps of 0.003 are 4000 cycles, although their quotient's whole part is 3999
        (
            {"step": A.FORTH, "cycles": 4049, "rules": SLOW_RULES},
            {"position_si": 0.0},
            {"effort_si": 0.003},
        ),
        ({"step": A.RESTING, "rest_cycles": 28}, {}, {"rest_cycles": 29}),
        ({"step": A.RESTING, "rest_cycles": 28}, {"at_rest": False}, {"rest_cycles": 0}),
        (
            *({"step": A.RESTING, "rest_cycles": 29, "cycles": 900}, {"position_si": 0.4}),
            {"step": A.BACK, "rest_cycles": 30, "cycles": 0, "from_si": 0.4},
        ),
        ({"step": A.RESTING, "cycles": 299}, {"at_rest": False}, {}),
        *(
            (
                *({"step": A.RESTING, "cycles": late}, {"at_rest": False}),
                {"step": A.FAILED, "why": Failure.KEEPS_MOVING},
            )
            for late in (300, 5000)
        ),
        *(
            (
                *({"step": A.ENDING, "rest_cycles": 29, **moved}, {}),
                {"step": A.DONE if why is None else A.FAILED, "rest_cycles": 30}
                | ({} if why is None else {"why": why}),
            )
            for moved, why in (
                ({"moved_forth_si": 0.035}, None),
                ({"moved_back_si": -0.035}, None),
                ({"moved_forth_si": 0.0349, "moved_back_si": 0.0349}, Failure.DOES_NOT_MOVE),
                ({"moved_forth_si": -0.035}, Failure.MOVES_AGAINST_TORQUE),
                (
                    {"moved_forth_si": 0.1, "moved_back_si": 0.035},
                    Failure.MOVES_AGAINST_TORQUE,
                ),
            )
        ),
        ({"step": A.WAITING}, {}, {}),
    ],
)
def test_a_sign_test_goes_on_by_what_a_cycle_shows(before, shown, after):
    now = replace(SignTest.begin(start()), **before)

    later = now.advance(RESTS._replace(**shown))

    expected = replace(now, **{"cycles": now.cycles + 1, **after})
    assert later == replace(expected, effort_si=pytest.approx(expected.effort_si))


def test_a_sign_test_begins_with_nothing_pushed_and_nothing_moved():
    nothing = dict.fromkeys(("moved_forth_si", "moved_back_si", "from_si", "rest_cycles"), 0)
    efforts = dict.fromkeys(("effort_forth_si", "effort_back_si"), 0.0)

    assert SignTest.begin(start()) == SignTest(
        axis="right/hip", requested_cycle=0, rules=RULES, period_s=0.01, **nothing, **efforts
    )
    assert SignTest.operation_mode is OperationMode.CYCLIC_SYNC_TORQUE
    assert Result(EventCode.HOMED) == Result(EventCode.HOMED, False, None, ())


@pytest.mark.parametrize(
    ("changes", "refusal"),
    [
        ({}, None),
        ({"homing": None}, Refusal(RefusalCode.NO_HOMING, "right/hip")),
        ({"sign_proven": False}, Refusal(RefusalCode.SIGN_NOT_PROVEN, "right/hip")),
        ({"sign_proven": False, "signs_must_be_proven": False}, None),
    ],
)
def test_a_homing_needs_its_settings_and_a_proven_sign_and_a_sign_test_neither(changes, refusal):
    axis = start()._replace(**changes)

    assert Homing.may_begin(axis) == refusal
    assert SignTest.may_begin(axis) is None


def test_a_homing_that_was_not_refused_and_has_no_settings_is_a_bug_of_ours():
    with pytest.raises(RuntimeError, match="right/hip cannot be homed"):
        Homing.begin(start()._replace(homing=None))


@pytest.mark.parametrize(
    ("kind", "mode", "by_drive", "bounds", "result"),
    [
        (Homing, Mode.REFERENCE, True, ((30.0, 0.3), (30.0, 3.0)), Result(EventCode.HOMED, True)),
        (
            *(SignTest, Mode.COMMISSION, False, ((12.0, 3.0), (12.0, 3.0))),
            Result(EventCode.SIGN_TESTED, False, (0.04, -0.05), (8.0, 0.04, -9.0, -0.05)),
        ),
    ],
)
def test_each_has_its_mode_its_limits_and_its_result(kind, mode, by_drive, bounds, result):
    run = kind.begin(start()._replace(cycle=7))
    usual = LIMITS._replace(effort_max_si=60.0, velocity_max_si=3.0)
    if kind is SignTest:
        efforts = {"effort_forth_si": 8.0, "effort_back_si": -9.0}
        run = replace(run, moved_forth_si=0.04, moved_back_si=-0.05, **efforts)

    assert (run.axis, run.requested_cycle, run.mode, run.by_drive) == (
        *("right/hip", 7, mode, by_drive),
    )
    assert (run.step, run.cycles, run.effort_si, run.why) == (
        *(AxisStep.WAITING, 0, 0.0, Failure.NONE),
    )
    assert run.result() == result
    for moving, (effort_max_si, velocity_max_si) in zip((True, False), bounds, strict=True):
        limits = run.limits(usual, moving=moving)
        assert limits == usual._replace(
            effort_max_si=effort_max_si, velocity_max_si=velocity_max_si
        )
    assert not run.is_over
    assert run.failed(Failure.KEEPS_MOVING).is_over
    searching = replace(run, step=AxisStep.SEARCHING)
    assert (run.searching, searching.searching) == (False, True)


HOMED, ATTAINED, NOWHERE = 0x1637, 0x1237, 0x0237
"""Statuswords: home attained and reached, attained, and neither."""


@pytest.mark.parametrize(
    ("changes", "statusword", "is_homing", "moves"),
    [
        ({}, HOMED, True, True),
        ({}, ATTAINED, True, True),
        ({}, NOWHERE, True, False),
        ({}, HOMED, False, False),
        ({"begun": False}, HOMED, True, False),
        ({"found": S.DONE}, HOMED, True, False),
        ({"found": S.ATTAINED}, HOMED, True, True),
        ({"found": S.ATTAINED}, ATTAINED, True, False),
    ],
)
def test_the_origin_moves_with_the_first_sample_that_shows_home(
    changes, statusword, is_homing, moves
):
    others = OperationMode.CYCLIC_SYNC_TORQUE, OperationMode.NONE
    run = replace(Homing.begin(start()), **{"begun": True, **changes})

    for mode in (OperationMode.HOMING,) if is_homing else others:
        feedback = FEEDBACK._replace(statusword=statusword, mode_display=mode)
        assert run.moves_origin(feedback) is moves
        assert not SignTest.begin(start()).moves_origin(feedback)
