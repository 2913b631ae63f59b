"""What is looked at over more than one cycle: balance, efforts, sums over a stride, spasms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safety_inputs import LIMITS
from sessions import CONFIGS

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
from daemon.core.safety.inverse_dynamics import ROW, InverseDynamics, evaluate
from daemon.core.safety.joints import Joint
from daemon.core.safety.spasm import STILL_CYCLES, SpasmRules, SpasmWatch, softened
from daemon.preflight.load import load
from observer.mechanism.friction import static_friction_of
from observer.mechanism.mechanism import gravity, mass_matrix
from tests.observer.mechanics import coriolis, damping

ROBOT = load(CONFIGS / "demo.toml").robot
LEG, FRICTIONS = leg_parameters(ROBOT), friction_parameters(ROBOT)
DT_S = 0.01
STILL = {"may_give_torque": True, "free": True, "pose_known": True}


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
        verdicts = evaluate(verdicts, LEG, FRICTIONS, pair)
    return verdicts


def test_a_balance_has_the_terms_of_the_equation_of_motion_at_its_middle_sample():
    def motion(time_s):
        return 0.2 + 0.5 * time_s + 3.0 * time_s**2, 0.5 - 0.4 * time_s + 2.0 * time_s**2

    verdicts = balance_of(motion, (30.0, -100.0))

    middle_s = (ROW - 2) * DT_S
    q = np.array(motion(middle_s))
    v = np.array((0.5 + 6.0 * middle_s, -0.4 + 4.0 * middle_s))
    a = np.array((6.0, 4.0))
    inertia = mass_matrix(LEG, q) @ a
    load_ = gravity(LEG, q) + coriolis(LEG, q, v) + damping(LEG, q, v)
    assert verdicts.known
    assert verdicts.inertia == pytest.approx(tuple(inertia), rel=1e-6)
    assert verdicts.load == pytest.approx(tuple(load_), rel=1e-6)
    for axis in (0, 1):
        friction = static_friction_of(FRICTIONS[axis], v[axis])
        rest = (30.0, -100.0)[axis] - inertia[axis] - load_[axis] - friction
        assert verdicts.residual(axis) == pytest.approx(rest, rel=1e-6)


def test_a_standing_joint_is_balanced_without_its_own_acceleration():
    def motion(time_s):
        return 0.2, 0.5 + 2.0 * time_s**2

    verdicts = balance_of(motion, (30.0, -100.0))

    q = np.array(motion((ROW - 2) * DT_S))
    coupled = mass_matrix(LEG, q)[0, 1] * 4.0
    assert verdicts.held(0) == pytest.approx(30.0 - verdicts.load[0] - coupled, rel=1e-6)


def test_a_sample_that_is_missing_breaks_the_row():
    def motion(_):
        return 0.2, 0.5

    verdicts = balance_of(motion, (0.0, 0.0))
    assert verdicts.known

    gone = evaluate(
        verdicts, LEG, FRICTIONS, (joint(0.2, 0.0, 0.0, fresh=False), joint(0.5, 0.0, 0.0))
    )
    assert not gone.known
    assert gone.load == verdicts.load
    first = evaluate(
        verdicts, LEG, FRICTIONS, (joint(0.2, 0.0, 0.0, elapsed_s=0.0), joint(0.5, 0, 0))
    )
    assert not first.known


def test_the_warm_up_compiles_what_a_cycle_calls(monkeypatch):
    calls = []

    def recorded(*arguments):
        calls.append([type(one) for one in arguments])
        return (0.0,) * 8

    monkeypatch.setattr(inverse_dynamics, "_terms", recorded)
    inverse_dynamics.warm_up(LEG, FRICTIONS)
    balance_of(lambda _: (0.2, 0.5), (0.0, 0.0))

    assert calls
    assert calls == [calls[0]] * len(calls)


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


@pytest.mark.parametrize(("cadence_hz", "cycles"), [(0.5, 200), (0.3, 333), (0.001, 1000)])
def test_a_stride_has_the_cycles_of_its_cadence(cadence_hz, cycles):
    assert stride_cycles(cadence_hz, DT_S) == cycles


# --- spasm ----------------------------------------------------------------------------------------

RULES = SpasmRules(10, stiffness_ratio=0.3, softening_ratio=0.1, recovery_ratio=0.005)
RISE, REST = 14.0, 0.05


def lasting(efforts, *, speed=-0.5, wanted=0.0, still=0):
    """How long a spasm has lasted after these efforts of the patient's, one a cycle."""
    watch = SpasmWatch(RULES.window_cycles)
    for effort in efforts:
        watch.update(effort, speed, wanted, still, RISE, REST)
    return watch.cycles


def ramp(peak, cycles):
    return [0.0] * 12 + list(np.linspace(0.0, peak, cycles + 1))[1:]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_fast_rise_against_the_motion_is_a_spasm_and_at_its_limit_it_is_none(sign):
    assert lasting([sign * e for e in ramp(RISE + 0.01, 10)], speed=-sign) == 1
    assert lasting([sign * e for e in ramp(RISE, 10)], speed=-sign) == 0


def test_a_slow_rise_is_none():
    assert lasting(ramp(2 * RISE, 30)) == 0


@pytest.mark.parametrize("motion", [{"speed": 0.5}, {"speed": -0.5, "wanted": 0.5}])
def test_a_push_along_with_the_motion_is_none(motion):
    assert lasting(ramp(2 * RISE, 10), **motion) == 0


def test_at_a_turn_of_the_gait_no_effort_is_along_with_the_motion():
    assert lasting(ramp(2 * RISE, 10), speed=0.9 * REST) > 0


def test_an_effort_that_is_let_go_is_no_spasm():
    assert lasting([2 * RISE] * 12 + ramp(0.0, 1)[12:] + [0.0] * 3, speed=0.5) == 0


def test_a_joint_that_gives_no_count_says_nothing_of_a_spasm():
    assert lasting(ramp(2 * RISE, 10), still=STILL_CYCLES - 1) > 0
    assert lasting(ramp(2 * RISE, 10), still=STILL_CYCLES) == 0


def test_a_spasm_lasts_until_half_of_its_rise_is_gone():
    risen = ramp(2 * RISE, 10)
    begun = lasting(risen)

    assert lasting([*risen, *[0.6 * RISE] * 50]) == begun + 50
    assert lasting([*risen, 0.4 * RISE]) == 0
    assert lasting([*risen, -2 * RISE]) == 0


def test_without_an_estimate_nothing_is_known_of_a_spasm():
    watch = SpasmWatch(RULES.window_cycles)
    for effort in ramp(2 * RISE, 10):
        watch.update(effort, -0.5, 0.0, 0, RISE, REST)
    watch.reset()

    assert (watch.cycles, watch.rise_si) == (0, 0.0)


@settings(derandomize=True)
@given(st.lists(st.booleans(), min_size=1, max_size=300))
def test_stiffness_falls_and_comes_back_by_rate_and_never_below_what_is_left_of_it(spasms):
    ratios = [1.0]
    for in_spasm in spasms:
        ratios.append(softened(ratios[-1], RULES, in_spasm=in_spasm))

    for in_spasm, before, now in zip(spasms, ratios, ratios[1:], strict=False):
        assert RULES.stiffness_ratio <= now <= 1.0
        if in_spasm:
            assert before - RULES.softening_ratio - 1e-12 <= now <= before
        else:
            assert before <= now <= before + RULES.recovery_ratio + 1e-12
    assert math.isfinite(ratios[-1])
