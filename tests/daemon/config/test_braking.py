"""The torque of a quick-stop ramp: what a stop from any motion asks, against what a drive has."""

import numpy as np
import pytest
from config_files import CONFIGS, Change, changed, copied

from daemon.config.robot import leg_parameters
from daemon.preflight.braking import braking_errors, braking_meanings
from daemon.preflight.load import load
from daemon.preflight.motion import decelerations
from daemon.preflight.report import examine, refusals
from daemon.preflight.workspace import gait_motions
from tests.observer.mechanics import acceleration

HIP = Change("limits.toml", "rad_per_s2 = 14.8", "rad_per_s2 = 200.0")
SLIDE = Change("limits.toml", "m_per_s2 = 15.4", "m_per_s2 = 20.0")
EMPTY = Change("demo.toml", '"robot.toml"', '"robot_empty.toml"')
GENERIC = (
    Change("demo.toml", "drives/hip_epos4.toml", "drives/hip_generic.toml"),
    Change("demo.toml", "drives/slide_epos4.toml", "drives/slide_generic.toml"),
)


def refused(tmp_path, *changes):
    settings = load(changed(copied(tmp_path), *changes))
    return next(refusals(settings, examine(settings)))


@pytest.mark.parametrize(
    ("changes", "key", "value", "allowed"),
    [
        (
            (HIP,),
            "hip.quick_stop_deceleration_rad_per_s2",
            "200.0",
            "<= 14.90 rad/s^2: at hip 13.6 deg, slide 0.262 m the ramp asks 500.9 N m of right/hip",
        ),
        (
            (SLIDE,),
            "slide.quick_stop_deceleration_m_per_s2",
            "20.0",
            "<= 15.45 m/s^2: at hip 30.2 deg, slide 0.931 m the ramp asks",
        ),
        (
            (Change("limits.toml", "hip.patient_nm = 8.0", "hip.patient_nm = 60.0"),),
            "hip.quick_stop_deceleration_rad_per_s2",
            "14.8",
            "none with this torque limit: ",
        ),
    ],
)
def test_a_deceleration_that_the_torque_limit_cannot_give_is_refused_with_one_that_would_pass(
    tmp_path, changes, key, value, allowed
):
    error = refused(tmp_path, *changes)

    assert error.file == str(tmp_path / "configs/limits.toml")
    assert (error.key, error.value) == (key, value)
    assert error.allowed.startswith(allowed)


def test_the_deceleration_that_would_pass_passes_and_a_little_more_does_not(tmp_path):
    said = float(refused(tmp_path / "much", SLIDE).allowed.split()[1])

    def judged(folder, deceleration):
        passing = SLIDE._replace(new=f"m_per_s2 = {deceleration:.2f}")
        settings = load(changed(copied(folder), passing))
        return list(braking_errors(settings, braking_meanings(settings)))

    assert not judged(tmp_path / "said", said)
    assert judged(tmp_path / "more", said + 0.02)


def test_both_axes_at_once_are_told_decelerations_that_pass_together(tmp_path):
    settings = load(changed(copied(tmp_path), HIP, SLIDE))

    hip, slide = (meaning.deceleration_max_si_per_s2 for meaning in braking_meanings(settings))

    assert (hip, slide) == pytest.approx((14.90, 15.45), abs=0.02)


@pytest.mark.parametrize("changes", [(), (*GENERIC, EMPTY)])
def test_the_limit_is_the_one_that_is_written_into_the_drive(tmp_path, changes):
    settings = load(changed(copied(tmp_path), *changes))

    report = examine(settings)

    for axis, braking in zip(report.axes, report.braking, strict=True):
        written = axis.torque_limit_raw * axis.torque_limit.effort_per_count_si
        assert braking.limit_si == pytest.approx(written)
        assert braking.limit_si <= axis.effort_limit_si
        assert braking.is_given


def test_an_empty_machine_has_no_patient_to_brake_against(tmp_path):
    empty = braking_meanings(load(changed(copied(tmp_path), EMPTY)))

    assert [braking.patient_si for braking in empty] == [0.0, 0.0]
    assert all(braking.required_si < 0.85 * braking.limit_si for braking in empty)


def test_every_stop_of_the_gait_has_the_torque_for_its_ramps():
    """By forward dynamics: what both drives must give, each axis braking or at rest."""
    settings = load(CONFIGS / "demo.toml")
    leg, ramps = leg_parameters(settings.robot), np.array(decelerations(settings.limits))
    limits = np.array([braking.limit_si for braking in braking_meanings(settings)])
    patient = np.array([settings.limits.stop.hip.patient_nm, settings.limits.stop.slide.patient_n])

    for motion in gait_motions(leg, settings.trainer.gait, 0.5):
        for moving in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0)):
            velocity = np.array(moving) * motion.velocity
            efforts = efforts_for(leg, motion.position, velocity, -np.sign(velocity) * ramps)
            assert (np.abs(efforts) + patient * moving <= limits).all()


def efforts_for(leg, position, velocity, wanted):
    """With which forward dynamics give these accelerations, without friction."""

    def given(efforts):
        return acceleration(leg, np.array(position), velocity, efforts, np.zeros(2), full=True)

    still = given(np.zeros(2))
    return np.linalg.solve(
        np.column_stack([given(one) - still for one in np.eye(2)]), wanted - still
    )
