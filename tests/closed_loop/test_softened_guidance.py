"""A spasm of either axis softens guidance of the whole leg, and what it softened pulls nothing."""

import math

import pytest
from gaitd_names import Cause, Mode, RequestKind
from records import both

from daemon.config.robot import leg_parameters
from daemon.ipc.record import ModeRequest
from observer.mechanism.mechanism import ratio_and_load


def guidance(session, share):
    """The efforts of guidance with this share of its stiffness in the last cycle but one."""
    now, later = (record.legs[0] for record in session.records[-2:])
    speeds = [drive.velocity for drive in session.records[-2].drives]
    robot = tuple(map(float, leg_parameters(session.settings.robot)))
    _, *load = ratio_and_load(robot, *both(now, "measured_position"))
    impedance = session.settings.trainer.gait.impedance
    stiffness = impedance.hip.stiffness_nm_per_rad, impedance.slide.stiffness_n_per_m
    damping = impedance.hip.damping_nm_s_per_rad, impedance.slide.damping_n_s_per_m
    return [
        load[axis]
        + share
        * stiffness[axis]
        * (now.axes[axis].reference_position - now.axes[axis].measured_position)
        + math.sqrt(share)
        * damping[axis]
        * (
            (later.axes[axis].reference_position - now.axes[axis].reference_position) / 0.01
            - speeds[axis]
        )
        for axis in (0, 1)
    ]


def sent(session):
    return [drive.target_effort for drive in session.records[-2].drives]


def test_a_spasm_softens_both_axes_and_a_hold_then_begins_where_the_leg_is(warm_gait):
    session = warm_gait
    session.run(1.3)
    assert sent(session) == pytest.approx(guidance(session, 1.0), abs=0.5)

    session.command("patient spasm")
    session.run_until(lambda _: session.core.legs[0].softened.spasm_ratio < 1.0, within_s=1.0)
    session.run(0.05)

    soft = session.settings.limits.spasm.stiffness_ratio
    assert session.record.mode == Mode.GAIT
    assert sent(session) == pytest.approx(guidance(session, soft), abs=0.5)

    session.gateway.request(RequestKind.MODE, ModeRequest(Mode.HOLD))
    held = session.run_until(lambda record: record.mode == Mode.HOLD, within_s=0.1).legs[0]
    before = session.records[-2].legs[0]
    assert abs(before.hip.reference_position - held.hip.measured_position) > 0.04
    assert both(held, "reference_position") == pytest.approx(
        both(held, "measured_position"), abs=0.005
    )


def test_who_leans_on_a_leg_that_is_held_has_no_spasm(warm_hold):
    session = warm_hold
    begun = len(session.records)

    for cycle in range(100):
        session.machine.trainers["right"].exert(min(1.0, cycle / 6) * 22.0, 0.0)
        session.run(0.01)

    rise_nm = session.settings.limits.spasm.hip.rise_nm
    efforts = [record.legs[0].hip.patient for record in session.records[begun:]]
    assert (
        max(later - before for before, later in zip(efforts[:-10], efforts[10:], strict=True))
        > rise_nm
    )
    assert (session.record.mode, session.record.verdict.cause) == (Mode.HOLD, Cause.NONE)
