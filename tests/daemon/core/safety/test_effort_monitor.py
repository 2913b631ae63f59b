"""What is looked at over more than one cycle: balance, efforts, sums over a stride."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safety_inputs import LIMITS
from sessions import demo

from daemon.config.robot import friction_parameters, leg_parameters
from daemon.core.safety import inverse_dynamics
from daemon.core.safety.effort_monitor import (
    SENT_COUNT,
    SETTLE_CYCLES,
    EffortWatch,
    record_sent,
    update,
)
from daemon.core.safety.energy import STRIDE_MAX_CYCLES, StrideSum, stride_cycles
from daemon.core.safety.inverse_dynamics import ROW, InverseDynamics, evaluate, needed
from daemon.core.safety.joints import Joint
from daemon.core.safety.sign_response import SAMPLES
from observer.mechanism.friction import OverPosition, at_position, static_friction_of
from observer.mechanism.mechanism import gravity, mass_matrix
from tests.observer.mechanics import coriolis, damping

ROBOT = demo().robot
LEG, FRICTIONS = leg_parameters(ROBOT), friction_parameters(ROBOT)
OVER = OverPosition(0.5, 0.1), OverPosition(-0.8, 0.55)
LAWS = tuple((tuple(law), tuple(over)) for law, over in zip(FRICTIONS, OVER, strict=True))
DT_S = 0.01
STILL = {"mismatch_cycles": 3, "may_give_torque": True, "free": True, "pose_known": True}


def frictions_at(position, velocity):
    """Friction of both axes where they are."""
    return [
        static_friction_of(at_position(law, over, at), speed)
        for law, over, at, speed in zip(FRICTIONS, OVER, position, velocity, strict=True)
    ]


def joint(position, velocity, effort, **change):
    return Joint(
        known=True,
        fresh=True,
        position_si=position,
        velocity_si=velocity,
        effort_si=effort,
        elapsed_s=DT_S,
    )._replace(**change)


def balance_of(motion, efforts, count=ROW):
    """The balance after samples of a motion q(t) of both axes, at equal times."""
    verdicts = InverseDynamics()
    for index in range(count):
        now, before = motion(index * DT_S), motion((index - 1) * DT_S)
        pair = tuple(
            joint(now[axis], (now[axis] - before[axis]) / DT_S, efforts[axis]) for axis in (0, 1)
        )
        verdicts = evaluate(verdicts, LEG, LAWS, pair)
    return verdicts


@pytest.mark.parametrize("count", [3, 4, 6])
def test_a_balance_has_the_terms_of_the_equation_of_motion_at_its_middle_sample(count):
    def motion(time_s):
        return 0.2 + 0.5 * time_s + 3.1 * time_s**2, 0.5 - 0.4 * time_s + 2.3 * time_s**2

    verdicts = balance_of(motion, (30.0, -100.0), count)

    middle_s = (count - 2) * DT_S
    q = np.array(motion(middle_s))
    v = np.array((0.5 + 6.2 * middle_s, -0.4 + 4.6 * middle_s))
    a = np.array((6.2, 4.6))
    assert verdicts.samples_in_a_row == count
    inertia = mass_matrix(LEG, q) @ a
    load_ = gravity(LEG, q) + coriolis(LEG, q, v) + damping(LEG, q, v)
    assert verdicts.known
    assert verdicts.inertia == pytest.approx(tuple(inertia), rel=1e-6)
    assert verdicts.load == pytest.approx(tuple(load_), rel=1e-6)
    for axis in (0, 1):
        friction = frictions_at(q, v)[axis]
        rest = (30.0, -100.0)[axis] - inertia[axis] - load_[axis] - friction
        assert verdicts.residual(axis) == pytest.approx(rest, rel=1e-6)


def test_a_standing_joint_is_balanced_without_its_own_acceleration():
    def motion(time_s):
        return 0.2, 0.5 + 2.0 * time_s**2

    verdicts = balance_of(motion, (30.0, -100.0))

    q = np.array(motion((ROW - 2) * DT_S))
    coupled = mass_matrix(LEG, q)[0, 1] * 4.0
    assert verdicts.held(0) == pytest.approx(30.0 - verdicts.load[0] - coupled, rel=1e-6)


def test_two_samples_in_a_row_are_too_few_and_nothing_is_computed_from_them():
    def motion(time_s):
        return 0.2 + 0.5 * time_s, 0.5 - 0.4 * time_s

    assert InverseDynamics() == (0, *[(0.0, 0.0)] * (len(InverseDynamics._fields) - 1))
    for count in (1, 2):
        few = balance_of(motion, (30.0, -100.0), count)
        assert not few.known
        assert (few.samples_in_a_row, few.measured) == (count, (30.0, -100.0))
        assert (few.position, few.load) == (motion((count - 1) * DT_S), (0.0, 0.0))


def test_a_sample_that_is_missing_breaks_the_row():
    def motion(_):
        return 0.2, 0.5

    verdicts = balance_of(motion, (0.0, 0.0))
    assert verdicts.known

    gone = evaluate(verdicts, LEG, LAWS, (joint(0.2, 0.0, 0.0, fresh=False), joint(0.5, 0.0, 0.0)))
    assert not gone.known
    assert gone.load == verdicts.load
    first = evaluate(verdicts, LEG, LAWS, (joint(0.2, 0.0, 0.0, elapsed_s=0.0), joint(0.5, 0, 0)))
    assert not first.known
    other = evaluate(verdicts, LEG, LAWS, (joint(0.2, 0.0, 0.0), joint(0.5, 0, 0, elapsed_s=0.0)))
    assert gone.samples_in_a_row == first.samples_in_a_row == other.samples_in_a_row == 0


@pytest.mark.parametrize(
    ("direction", "acceleration", "counted"),
    [
        # Friction brakes the hip, and would add to the slide's need.
        (1.0, (-20.0, -20.0), (1.0, 0.0)),
        (1.0, (20.0, 20.0), (0.0, 1.0)),
        (-1.0, (20.0, 20.0), (1.0, 0.0)),
    ],
)
def test_a_motion_needs_inertia_coriolis_and_dampers_less_friction(
    direction, acceleration, counted
):
    q, v, a = np.array((0.2, 0.5)), direction * np.array((0.9, -0.4)), np.array(acceleration)

    found = needed(LEG, LAWS, tuple(q), tuple(v), acceleration)

    friction = frictions_at(q, v)
    expected = mass_matrix(LEG, q) @ a + coriolis(LEG, q, v) + damping(LEG, q, v)
    assert np.all(np.abs(expected) > np.abs(friction))
    assert found.certain == pytest.approx(tuple(expected + np.array(counted) * friction), rel=1e-6)
    assert found.whole == pytest.approx(tuple(expected + friction), rel=1e-6)


def test_a_motion_that_friction_brakes_enough_needs_nothing_and_rest_neither():
    q, v = np.array((0.2, 0.5)), np.array((0.9, -0.4))
    friction = np.array(frictions_at(q, v))
    rest = coriolis(LEG, q, v) + damping(LEG, q, v)
    braking = np.linalg.solve(mass_matrix(LEG, q), -0.5 * friction - rest)

    assert needed(LEG, LAWS, tuple(q), tuple(v), tuple(braking)).certain == (0.0, 0.0)
    assert needed(LEG, LAWS, tuple(q), (0.0, 0.0), (0.0, 0.0)).whole == (0.0, 0.0)


def test_the_warm_up_compiles_what_a_cycle_calls(monkeypatch):
    calls = {"_terms": [], "_needed": []}

    def recorded(name, count):
        def call(*arguments):
            calls[name].append(arguments)
            return (0.0,) * count

        monkeypatch.setattr(inverse_dynamics, name, call)

    recorded("_terms", 8)
    recorded("_needed", 4)
    inverse_dynamics.warm_up(LEG, LAWS)
    balance_of(lambda _: (0.2, 0.5), (0.0, 0.0))
    needed(LEG, LAWS, (0.2, 0.5), (0.1, 0.1), (1.0, 1.0))

    for made in calls.values():
        first, second = ([type(one) for one in call] for call in made)
        assert made[0] == (LEG, *LAWS, *[0.0] * 6)
        assert first == second


# --- efforts --------------------------------------------------------------------------------------


def sent(*efforts):
    watch = EffortWatch()
    for effort in efforts:
        watch = record_sent(watch, effort, active=True)
    return watch


def looked(watch, effort=0.0, balance=InverseDynamics(), cycles=1, still=0, **change):  # noqa: B008 - frozen
    for _ in range(cycles):
        at = joint(0.0, 0.0, effort, still_cycles=still)
        watch = update(watch, at, balance, 0, LIMITS, **(STILL | change))
    return watch


def test_an_effort_that_stays_the_same_is_counted_while_the_joint_moves_under_power():
    moved = looked(looked(EffortWatch(), 3.0), 3.0, cycles=7)

    assert moved.unchanged_cycles == 7
    assert looked(moved, 3.1).unchanged_cycles == 0
    assert looked(moved, 3.0, still=1).unchanged_cycles == 0
    assert looked(moved, 3.0, may_give_torque=False).unchanged_cycles == 0
    assert looked(EffortWatch(), -0.5).unchanged_cycles == 0
    assert looked(EffortWatch(sent_si=(1.0,)), 3.0, cycles=3).unchanged_cycles == 0


@pytest.mark.parametrize(("targets", "count"), [((3.0, 3.0, 3.0), 0), ((3.0, 3.0, 3.1), 4)])
def test_a_target_torque_that_stays_the_same_may_give_the_same_effort(targets, count):
    watch = looked(sent(*targets), 3.0)

    assert looked(watch, 3.0, cycles=4).unchanged_cycles == count


@pytest.mark.parametrize("effort", [9.9, 10.0, 30.0, 40.0])
def test_an_effort_that_was_sent_within_the_last_cycles_is_no_gap(effort):
    gap_si = looked(sent(10.0, 40.0, 20.0), effort).gap_si

    assert gap_si == pytest.approx(max(10.0 - effort, 0.0))


def test_a_drive_that_does_not_give_its_effort_is_counted_from_the_limit_on():
    watch = sent(*[10.0] * SENT_COUNT)
    limit = LIMITS.effort_deviation_max_si

    assert looked(watch, 10.0 + limit, cycles=9).gap_cycles == 0
    assert looked(watch, 10.0 + limit + 0.01, cycles=9).gap_cycles == 9
    assert looked(looked(watch, 99.0, cycles=9), 10.0).gap_cycles == 0


def test_nothing_is_compared_before_the_command_could_act_or_after_a_break():
    assert looked(sent(10.0, 10.0), 99.0).gap_si == 0.0
    broken = record_sent(sent(10.0, 10.0, 10.0), 0.0, active=False)
    assert looked(broken, 99.0).gap_si == 0.0


def test_a_drive_without_power_that_shows_an_effort_has_a_wrong_sensor():
    watch = sent(10.0, 10.0, 10.0)

    settling = looked(watch, 10.0, cycles=SETTLE_CYCLES, may_give_torque=False)
    settled = looked(settling, -7.0, may_give_torque=False)

    assert settling.gap_si == 0.0
    assert settled.gap_si == 7.0
    assert looked(settled, -7.0, may_give_torque=True).unpowered_cycles == 0


def test_without_a_sample_nothing_counts():
    watch = sent(10.0, 10.0, 10.0)
    at = joint(0.0, 0.0, 99.0, fresh=False)

    assert update(watch, at, InverseDynamics(), 0, LIMITS, **STILL) == watch


def opposing(push, motion, row=ROW):
    return InverseDynamics(
        samples_in_a_row=row,
        effort=(push + 4.0, 0.0),
        load=(4.0, 0.0),
        inertia=(0.5 * motion, 0.0),
        friction=(0.5 * motion, 0.0),
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_effort_one_way_and_motion_the_other_is_counted_and_less_than_the_limit_is_not(sign):
    limit = LIMITS.sign_mismatch_effort_min_si

    for push, motion, counted in (
        (limit + 1, -limit - 1, True),
        (limit + 1, -limit + 1, False),
        (limit - 1, -limit - 1, False),
        (limit + 1, limit + 1, False),
    ):
        watch = looked(EffortWatch(), balance=opposing(sign * push, sign * motion), cycles=3)
        assert (watch.sign_mismatch_cycles == 3) == counted


def test_the_response_is_judged_in_a_mismatch_that_counts_and_the_patient_is_what_explains_it():
    watch = EffortWatch()
    ratios = []
    for k in range(SAMPLES + 3):
        push = 40.0 - 5.0 * k  # beyond the limit, against the motion, from the twelfth sample on
        watch = looked(watch, balance=opposing(push, push + 70.0))
        ratios.append(watch.response_ratio)

    assert (watch.sign_mismatch_cycles, watch.patient_si) == (2, 70.0)
    assert set(ratios) == {math.inf}
    judged = looked(watch, balance=opposing(-33.0, 37.0))
    assert judged.response_ratio < 0.01
    assert looked(judged, balance=opposing(-33.0, 37.0)).response_ratio < 0.01
    ended = looked(judged, balance=opposing(-19.0, 51.0))
    assert (ended.sign_mismatch_cycles, ended.response_ratio) == (0, math.inf)
    gap = looked(judged, balance=opposing(-33.0, 37.0, row=ROW - 1))
    assert (gap.samples, gap.patient_si, gap.response_ratio) == ((), 0.0, math.inf)
    jumped = looked(judged, balance=opposing(-33.0, 37.0 + LIMITS.sign_mismatch_effort_min_si + 1))
    assert jumped.response_ratio == math.inf


@pytest.mark.parametrize(
    "change", [{"may_give_torque": False}, {"free": False}, {"pose_known": False}]
)
def test_a_joint_without_power_or_place_or_at_its_end_stop_says_nothing_of_signs(change):
    watch = looked(EffortWatch(), balance=opposing(90.0, -90.0), cycles=3, **change)

    assert watch.sign_mismatch_cycles == 0


def test_a_balance_that_is_not_of_this_cycle_says_nothing_of_signs():
    watch = looked(EffortWatch(), balance=opposing(90.0, -90.0, row=ROW - 1), cycles=3)

    assert watch.sign_mismatch_cycles == 0


def test_what_a_joint_held_is_remembered_from_when_it_began_to_stand():
    watch = EffortWatch()
    for still in range(60):
        effort_si = 10.0 if still < 20 else 30.0
        watch = looked(watch, balance=InverseDynamics(effort=(effort_si, 0.0)), still=still)

    assert watch.held_before_still_si == pytest.approx(10.0, abs=2.0)
    assert watch.held_si == pytest.approx(30.0, abs=0.1)


def test_a_new_watch_has_seen_nothing_and_keeps_the_newest_three_commands():
    new = EffortWatch()
    assert (new.sent_si, new.samples, new.response_ratio) == ((), (), math.inf)
    others = set(EffortWatch.__struct_fields__) - {"sent_si", "samples", "response_ratio"}
    assert {getattr(new, name) for name in others} == {0}
    assert sent(1.0, 2.0, 3.0, 4.0, 5.0).sent_si == (3.0, 4.0, 5.0)


@pytest.mark.parametrize(
    ("push", "motion", "mismatch"),
    [
        (0.5, -0.25, 0.25),
        (-0.25, 0.5, 0.25),
        (0.5, 0.5, 0.0),
        (-0.5, -0.5, 0.0),
        (8.0, 0.0, 0.0),
        (0.0, -8.0, 0.0),
    ],
)
def test_a_mismatch_is_the_smaller_of_push_and_motion_where_their_signs_differ(
    push, motion, mismatch
):
    def of(row=ROW, **change):
        balance = opposing(push, motion, row)
        return looked(EffortWatch(), balance=balance, **change).sign_mismatch_si

    assert of() == mismatch
    assert of(row=ROW - 1) == of(free=False) == of(pose_known=False) == 0.0


def test_a_mismatch_of_just_the_limit_is_not_counted():
    limit = LIMITS.sign_mismatch_effort_min_si
    watch = looked(EffortWatch(), balance=opposing(limit, -limit))

    assert (watch.sign_mismatch_si, watch.sign_mismatch_cycles) == (limit, 0)


def test_a_held_effort_is_a_mean_with_three_tenths_of_the_newest_and_none_without_a_pose():
    balance = InverseDynamics(effort=(10.0, 0.0))
    before = EffortWatch(held_si=20.0)

    assert looked(EffortWatch(), balance=balance).held_si == 3.0
    assert looked(before, balance=balance).held_si == 17.0
    assert looked(before, balance=balance, pose_known=False).held_si == 20.0


@pytest.mark.parametrize(
    ("still", "effort", "held"),
    [(0, 7.0, 2.0), (1, 7.0, 2.0), (2, 6.0, 2.0), (4, 6.0, 2.0), (5, 6.0, 2.0), (6, 6.0, 5.0)],
)
def test_what_was_before_standstill_is_kept_from_its_own_cycle_on(still, effort, held):
    before = EffortWatch(held_si=2.0, held_before_still_si=5.0, effort_before_still_si=6.0)
    balance = InverseDynamics(effort=(2.0, 0.0))

    watch = looked(before, effort=7.0, balance=balance, still=still)

    assert (watch.effort_before_still_si, watch.held_before_still_si) == (effort, held)


@pytest.mark.parametrize(("unpowered_cycles", "gap"), [(9, 0.0), (10, 7.0)])
def test_a_current_has_ten_cycles_to_decay(unpowered_cycles, gap):
    before = EffortWatch(unpowered_cycles=unpowered_cycles)

    assert looked(before, -7.0, may_give_torque=False).gap_si == gap


# --- sums -----------------------------------------------------------------------------------------


@settings(derandomize=True, deadline=None)
@given(
    values=st.lists(st.floats(-100, 100), max_size=60),
    cycles=st.integers(min_value=1, max_value=70),
)
def test_a_sum_is_over_the_newest_cycles_and_none_while_there_are_fewer(values, cycles):
    total = StrideSum()
    for value in values:
        total.add(value)

    assert total.so_far(cycles) == pytest.approx(sum(values[-cycles:]), abs=1e-9)
    if cycles > len(values):
        assert total.over(cycles) is None
    else:
        assert total.over(cycles) == pytest.approx(sum(values[-cycles:]), abs=1e-9)
    total.clear()
    assert total.so_far(cycles) == 0.0


def test_a_sum_forgets_what_is_older_than_the_slowest_stride():
    total = StrideSum()
    for _ in range(2 * STRIDE_MAX_CYCLES):
        total.add(1.0)

    assert total.over(STRIDE_MAX_CYCLES) == STRIDE_MAX_CYCLES
    assert total.over(STRIDE_MAX_CYCLES + 1) is None


@pytest.mark.parametrize(
    ("cadence_hz", "cycles"), [(0.5, 200), (0.3, 333), (0.001, 1000), (100.0, 1), (300.0, 1)]
)
def test_a_stride_has_the_cycles_of_its_cadence(cadence_hz, cycles):
    assert stride_cycles(cadence_hz, DT_S) == cycles
