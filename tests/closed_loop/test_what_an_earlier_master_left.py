"""Objects that a drive adds to its targets: cleared without power; noticed if they come back."""

import itertools

from gaitd_names import Cause, Mode
from sessions import new_session, reaches_rest_in_fault

from drives.signals import PowerState

POSITION_OFFSET, VELOCITY_OFFSET, TORQUE_OFFSET = 0x60B0, 0x60B1, 0x60B2
AXES = ("right/hip", "right/slide")


def put(session, axis, index, value):
    session.machine.world.node(axis).dictionary.put(index, 0, value)


def value(session, axis, index):
    return session.machine.world.node(axis).dictionary.value(index, 0)


def moved(session, begun):
    """Largest distance of both joints from where they were at a row of the truth, rad and m."""
    rows = session.truth.rows[begun:]
    hip, slide = rows[0].hip_angle_rad, rows[0].slide_position_m
    return (
        max(abs(row.hip_angle_rad - hip) for row in rows),
        max(abs(row.slide_position_m - slide) for row in rows),
    )


def test_offsets_of_an_earlier_master_move_no_joint(position_configs):
    session = new_session(position_configs)
    left = {POSITION_OFFSET: 2000, VELOCITY_OFFSET: 100, TORQUE_OFFSET: 200}
    places = list(itertools.product(AXES, left))
    for axis, index in places:
        put(session, axis, index, left[index])
    session.until_ready()
    begun = len(session.truth.rows) - 1

    session.enable()
    session.run(1.0)

    assert [value(session, *place) for place in places] == [0] * len(places)
    assert session.record.mode == Mode.HOLD
    hip_rad, slide_m = moved(session, begun)
    assert hip_rad < 0.005
    assert slide_m < 0.005


def test_a_drive_that_holds_elsewhere_than_it_was_told_is_stopped(warm_position_hold):
    session, axis = warm_position_hold, "right/slide"
    session.run(0.2)

    put(session, axis, POSITION_OFFSET, 1200)
    session.run_until(lambda record: record.mode != Mode.HOLD, within_s=0.5)

    verdict = session.record.verdict
    assert (verdict.cause, verdict.drive) == (Cause.NOT_FOLLOWING, axis)
    reaches_rest_in_fault(session)


def test_a_leg_that_is_pushed_out_of_its_hold_is_not_let_go(warm_hold):
    session = warm_hold
    begun = len(session.truth.rows) - 1

    session.machine.trainers["right"].exert(40.0, 0.0)
    session.run(1.5)

    record = session.record
    assert (record.verdict.cause, record.verdict.drive) == (Cause.TRACKING_LIMIT, "right/hip")
    assert record.mode == Mode.FAULT
    assert {drive.power_state for drive in record.drives} == {PowerState.OPERATION_ENABLED}
    assert max(moved(session, begun)) < 0.16
