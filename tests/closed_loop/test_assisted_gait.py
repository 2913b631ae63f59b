"""A gait with impedance guidance under a controller: assist on top of it, and less stiffness."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from controllers import Controller, constant
from gaitd_names import Cause, Mode, RequestKind, Role
from msgspec.structs import replace as replace_fields
from records import both
from sessions import elsewhere

from daemon.ipc.record import AxisPlan, ModeRequest, Plan

STIFFNESS_STEP = 0.01
"""1 per second."""
GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=60.0)
HOLD = ModeRequest(Mode.HOLD)


@pytest.fixture
def walking(warm_gait):
    """A gait under a controller of this law."""
    return lambda law: (warm_gait, Controller(warm_gait.gateway, law))


def lag(records):
    """Mean distance to the reference: rad, m."""
    off = [
        np.subtract(both(one.legs[0], "measured_position"), both(one.legs[0], "reference_position"))
        for one in records
    ]
    return np.abs(off).mean(axis=0)


def test_assist_adds_to_guidance_and_the_gait_goes_on(warm_fast_gait):
    session = warm_fast_gait
    controller = Controller(session.gateway, constant(hip_nm=10.0))
    session.run(2.1)
    pushed = session.records[-200:]
    controller.law = constant(hip_nm=-10.0)
    session.run(2.1)
    pulled = session.records[-200:]

    record = session.record
    assert (record.mode, record.verdict.cause) == (Mode.GAIT, Cause.NONE)
    ahead = [
        np.mean(
            [r.legs[0].hip.measured_position - r.legs[0].hip.reference_position for r in records]
        )
        for records in (pushed, pulled)
    ]
    # 20 N m between the two, on a spring of 300 N m/rad.
    assert ahead[0] - ahead[1] == pytest.approx(20 / 300, rel=0.3)


def test_a_stiffness_scale_softens_guidance_by_its_rate_and_is_given_back_the_same_way(
    warm_fast_gait,
):
    session = warm_fast_gait
    controller = Controller(session.gateway, constant())
    stiff = lag(session.records[-200:])
    controller.law = constant(stiffness_ratio=0.4)
    session.run(2.6)
    soft = lag(session.records[-200:])
    assert session.record.legs[0].stiffness_ratio == pytest.approx(0.4)
    controller.law = constant(stiffness_ratio=1.0)
    session.run(0.7)

    assert session.record.mode == Mode.GAIT
    assert soft[0] > 1.5 * stiff[0]
    ratios = [record.legs[0].stiffness_ratio for record in session.records]
    assert ratios[-1] == pytest.approx(1.0)
    assert np.abs(np.diff(ratios)).max() <= STIFFNESS_STEP * 1.001


def test_a_gait_under_a_controller_that_is_gone_brakes_where_the_leg_is_and_holds(walking):
    session, _ = walking(constant(stiffness_ratio=0.3))
    session.run(1)
    session.gateway.end_lease()

    held = session.run_until(lambda record: record.mode == Mode.HOLD, within_s=0.3)
    records = session.records
    session.run(0.6)

    record = session.record
    assert (record.mode, record.verdict.cause) == (Mode.HOLD, Cause.NONE)
    assert record.assist.lapse_count == 1
    assert (both(record.legs[0], "assist"), record.legs[0].stiffness_ratio) == (
        (0.0, 0.0),
        pytest.approx(1.0),
    )
    for drive, was in zip(record.drives, held.drives, strict=True):
        assert abs(drive.velocity) < 0.03
        assert abs(drive.position - was.position) < 0.15
    before, after = next(
        (a, b) for a, b in pairwise(records) if (a.mode, b.mode) == (Mode.GAIT, Mode.HOLD)
    )
    assert abs(before.legs[0].hip.reference_position - before.legs[0].hip.measured_position) > 0.015
    assert both(after.legs[0], "reference_position") == pytest.approx(
        both(after.legs[0], "measured_position"), abs=0.005
    )
    for was, now, small in zip(before.drives, after.drives, (0.5, 5.0), strict=True):
        assert abs(now.target_effort - was.target_effort) < small


def test_a_gait_in_which_nothing_is_in_force_does_not_care_about_leases(walking):
    session, controller = walking(constant(hip_nm=5.0))
    session.run(0.3)
    controller.law = constant()
    session.run(0.2)
    session.gateway.end_lease()
    controller.running = False

    session.run(0.5)

    record = session.record
    assert (record.mode, record.assist.lapse_count) == (Mode.GAIT, 0)


def test_a_gait_that_a_person_ends_is_held_where_its_reference_is_unless_it_is_softened(walking):
    session, controller = walking(constant(hip_nm=10.0))
    session.run(1)

    def held(one):
        one.execute(RequestKind.MODE, HOLD)
        return next(
            (a.legs[0], b.legs[0])
            for a, b in pairwise(one.records)
            if (a.mode, b.mode) == (Mode.GAIT, Mode.HOLD)
        )

    before, after = elsewhere(session, held)
    assert abs(before.hip.reference_position - before.hip.measured_position) > 0.03
    assert both(after, "reference_position") == pytest.approx(
        both(before, "reference_position"), abs=0.015
    )

    controller.law = constant(stiffness_ratio=0.4)
    session.run(1)
    before, after = held(session)
    assert abs(before.hip.reference_position - before.hip.measured_position) > 0.03
    assert both(after, "reference_position") == pytest.approx(
        both(after, "measured_position"), abs=0.015
    )


def test_the_end_of_a_gait_ends_its_assist_without_a_lapse(walking):
    session, controller = walking(constant(hip_nm=5.0, stiffness_ratio=0.5))
    session.run(1)
    leg = session.core.legs[0]
    assert controller.running
    leg.exercise = replace(leg.exercise, plan=replace(leg.exercise.plan, duration_s=0.0))
    session.run_until(lambda record: record.mode == Mode.HOLD, within_s=8)
    session.run(0.3)

    record = session.record
    assert record.assist.lapse_count == 0
    assert both(record.legs[0], "assist") == (0.0, 0.0)
    assert record.legs[0].stiffness_ratio == pytest.approx(1.0)


def asking_as(gateway, role, cap_nm):
    """From now on requests come from a client of this role, with a plan that caps the hip."""
    plan = Plan(1.0, 1.0, 600.0, hip=AxisPlan(cap_nm))

    def of_role(states):
        return [
            replace_fields(state, request=replace_fields(state.request, role=role, plan=plan))
            for state in states
        ]

    gateway.change = of_role


def test_the_cap_is_that_of_the_newest_gait_also_where_it_is_higher_than_before(warm_hold):
    Controller(warm_hold.gateway, constant(hip_nm=6.0))

    for role, cap_nm, taken_nm in (
        (Role.SESSION, 4.0, 0.0),
        (Role.SESSION, 8.0, 6.0),
        (Role.SESSION, 4.0, 0.0),
        (Role.OPERATOR, 4.0, 6.0),
    ):
        asking_as(warm_hold.gateway, role, cap_nm)
        warm_hold.execute(RequestKind.MODE, GAIT)
        warm_hold.run(0.1)
        assert warm_hold.record.legs[0].hip.assist == pytest.approx(taken_nm)
        asking_as(warm_hold.gateway, Role.OPERATOR, cap_nm)
        warm_hold.execute(RequestKind.MODE, HOLD)
        warm_hold.run(0.3)


def test_the_need_of_the_reference_is_the_work_of_the_drives_on_a_passive_leg(session):
    session.run(4.0)  # a stride: what springs and gravity take, they give back

    stride = session.records[-401:]
    references = np.array([both(one.legs[0], "reference_position") for one in stride])
    positions = np.array([both(one.legs[0], "measured_position") for one in stride])
    needed = np.array([both(one.legs[0], "needed") for one in stride[1:]])
    efforts = np.array([both(one.legs[0], "effort") for one in stride[1:]])
    needed_j = (needed * np.diff(references, axis=0)).sum()
    assert needed_j == pytest.approx((efforts * np.diff(positions, axis=0)).sum(), rel=0.05)
    assert needed_j > 20.0
