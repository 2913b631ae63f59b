"""[homing] of an axis file against its profile and against the empty machine."""

import pytest
from config_files import Change, changed, copied

from daemon.preflight.homing import homing_errors
from daemon.preflight.load import ConfigError, load

EMPTY = Change("demo.toml", '"robot.toml"', '"robot_empty.toml"')
HIP = "drives/hip_epos4.toml"


def refused(tmp_path, *changes):
    with pytest.raises(ConfigError) as error:
        load(changed(copied(tmp_path), *changes))
    return error.value


def refused_by_check(tmp_path, *changes):
    with pytest.raises(ConfigError) as error:
        raise next(homing_errors(load(changed(copied(tmp_path), *changes))))
    return error.value


def test_the_shipped_homing_gets_home_in_the_empty_machine(tmp_path):
    assert not list(homing_errors(load(changed(copied(tmp_path), EMPTY))))


def test_no_axis_is_homed_with_a_patient_so_nothing_is_asked_of_homing_then(tmp_path):
    weak = Change(HIP, "effort_max_si = 50.0", "effort_max_si = 1.0")

    assert not list(homing_errors(load(changed(copied(tmp_path), weak))))


def test_a_torque_limit_below_load_and_friction_at_home_is_refused(tmp_path):
    error = refused_by_check(
        tmp_path, EMPTY, Change(HIP, "effort_max_si = 50.0", "effort_max_si = 40.0")
    )

    assert error.file.endswith(HIP)
    assert error.key == "homing.effort_max_si"
    assert "load and friction need 46.0" in error.allowed


def test_friction_that_rises_towards_home_needs_more_torque_there(tmp_path):
    rising = Change("robot_empty.toml", "hip.slope_per_rad = 0.0", "hip.slope_per_rad = -0.5")
    enough = Change(HIP, "effort_max_si = 50.0", "effort_max_si = 47.0")

    error = refused_by_check(tmp_path, EMPTY, rising, enough)

    assert error.key == "homing.effort_max_si"
    assert "load and friction need 48.2" in error.allowed


def test_a_stop_current_that_the_springs_alone_need_would_make_a_home_that_is_not_there(tmp_path):
    felt = Change(HIP, "method = 17 ", "stop_current_a = 4.5\nmethod = -4 ")

    error = refused_by_check(tmp_path, EMPTY, felt)

    assert error.key == "homing.stop_current_a"
    assert "need 46.0 of 25.1" in error.allowed


def test_a_home_that_the_leg_cannot_reach_is_refused(tmp_path):
    error = refused_by_check(tmp_path, EMPTY, Change(HIP, "home_si = -0.4014", "home_si = 2.5"))

    assert error.key == "homing.home_si"


@pytest.mark.parametrize(
    ("change", "key", "allowed"),
    [
        (Change(HIP, "method = 17 ", "method = 5 "), "homing.method", "one of -4, -3"),
        (Change(HIP, "method = 17 ", "method = -4 "), "homing.stop_current_a", "given: method -4"),
        (
            Change("drives/profiles/epos4.toml", "[homing]", "[unused]"),
            "unused",
            "unknown key",
        ),
    ],
)
def test_a_homing_that_the_drive_does_not_have_is_refused(tmp_path, change, key, allowed):
    error = refused(tmp_path, change)

    assert error.key == key
    assert allowed in error.allowed
