"""A spasm of either axis softens guidance of the whole leg, and what it softened pulls nothing."""

import math

import pytest
from gaitd_names import Cause, Mode, RequestKind
from records import both
from sessions import changed_configs, new_session

from daemon.config.robot import leg_parameters
from daemon.ipc.record import ModeRequest
from observer.mechanism.mechanism import ratio_and_load

BEFORE = "[[patient.programme]]                  # one hard contraction against the motion"
SPASM = """[[patient.programme]]
name = "{axis}_spasm"

[[patient.programme.effort]]
kind = "spasm"
at_s = 0.0
until_s = 2.5
rise_s = 0.06
fall_s = 0.8
hip.torque_nm = {hip_nm}
slide.force_n = {slide_n}

"""
LEANS = SPASM.format(axis="hip", hip_nm=22.0, slide_n=0.0).replace("hip_spasm", "leans")
SPASMS = LEANS.replace('"spasm"', '"steady"') + SPASM.format(axis="hip", hip_nm=30.0, slide_n=0.0)
SPASMS += SPASM.format(axis="slide", hip_nm=0.0, slide_n=150.0)


@pytest.fixture(scope="module")
def tense(tmp_path_factory):
    """Each axis of the patient can have a spasm of its own; and he can lean, as quickly."""
    folder = tmp_path_factory.mktemp("spasms")
    return changed_configs(folder, ("plant.toml", BEFORE, SPASMS + BEFORE))


@pytest.fixture(scope="module")
def warm_tense_gait(tense):
    """A gait at 0.25 Hz."""
    return new_session(tense).walk(duration_s=5.3)


@pytest.fixture(scope="module")
def warm_tense_hold(tense):
    """Both axes hold."""
    return new_session(tense).enable()


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


@pytest.mark.parametrize("axis", ["hip", "slide"])
def test_a_spasm_of_one_axis_softens_both_and_a_hold_then_begins_where_the_leg_is(
    warm_tense_gait, axis
):
    session = warm_tense_gait
    assert sent(session) == pytest.approx(guidance(session, 1.0), abs=0.5)

    session.command(f"patient {axis}_spasm")
    session.run(0.3)

    soft = session.settings.limits.spasm.stiffness_ratio
    assert session.record.mode == Mode.GAIT
    assert sent(session) == pytest.approx(guidance(session, soft), abs=0.5)

    session.gateway.request(RequestKind.MODE, ModeRequest(Mode.HOLD))
    held = session.run_until(lambda record: record.mode == Mode.HOLD, within_s=0.1).legs[0]
    before = session.records[-2].legs[0].axes
    far = 0.04 if axis == "hip" else 0.03
    place = ("hip", "slide").index(axis)
    assert abs(before[place].reference_position - held.axes[place].measured_position) > far
    assert both(held, "reference_position") == pytest.approx(
        both(held, "measured_position"), abs=0.005
    )


def test_who_leans_on_a_leg_that_is_held_has_no_spasm(warm_tense_hold):
    session = warm_tense_hold
    begun = len(session.records)

    session.command("patient leans")
    session.run(1.0)

    rise_nm = session.settings.limits.spasm.hip.rise_nm
    efforts = [record.legs[0].hip.patient for record in session.records[begun:]]
    assert (
        max(later - before for before, later in zip(efforts[:-10], efforts[10:], strict=True))
        > rise_nm
    )
    assert (session.record.mode, session.record.verdict.cause) == (Mode.HOLD, Cause.NONE)
