"""Check of homing against the mechanism of the empty machine, for `gaitd check`.

A drive that homes on a mechanical stop detects it by its current. If the weight and the springs of
a pose on the way need as much, the home is wrong. So the allowed effort must exceed the load at
home and the friction.
"""

from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import LegDrives, Settings
from daemon.config.drive_plan import effort_per_motor_nm
from daemon.config.robot import friction_over_position, friction_parameters, leg_parameters
from daemon.core.motion.gait_shape import load_at
from daemon.preflight.motion import mean_pose
from drives.cia402.homing import Homing
from drives.cia402.profile import DriveDescription
from observer.mechanism.friction import at_position
from observer.mechanism.mechanism import WorkspaceError
from observer.mechanism.parameters import LegParameters


def homing_errors(settings: Settings) -> Errors:
    """Homings whose effort does not suffice to reach home, by the axis file and the key."""
    if settings.robot.patient is not None:
        return  # no homing with a patient
    leg = leg_parameters(settings.robot)
    for drives in settings.legs:
        for axis in range(2):
            yield from _check_axis(settings, leg, drives, axis)


def _check_axis(settings: Settings, leg: LegParameters, drives: LegDrives, axis: int) -> Errors:
    drive, file = ((drives.hip, drives.hip_file), (drives.slide, drives.slide_file))[axis]
    homing = drive.axis.homing
    if homing is None:
        return
    pose = list(mean_pose(settings, leg))
    pose[axis] = homing.home_si
    try:
        load_si = abs(load_at(leg, (pose[0], pose[1]))[axis])
    except WorkspaceError as error:
        allowed = f"a position that the leg reaches with its other axis at mid pose: {error}"
        yield ConfigError(file, "homing.home_si", homing.home_si, allowed)
        return
    law, over = friction_parameters(settings.robot)[axis], friction_over_position(settings.robot)
    least_si = load_si + at_position(law, over[axis], homing.home_si).stribeck
    for key, value, effort_si in _efforts(homing, drive):
        if effort_si <= least_si:
            allowed = f"more: at home load and friction need {least_si:.1f} of {effort_si:.1f}"
            yield ConfigError(file, f"homing.{key}", value, allowed)


def _efforts(homing: Homing, drive: DriveDescription) -> list[tuple[str, float, float]]:
    """Keys of a homing, their values, and the effort at the joint that each allows."""
    efforts = [("effort_max_si", homing.effort_max_si, homing.effort_max_si)]
    if homing.stop_current_a is not None:
        constant = drive.axis.motor.torque_constant_nm_per_a
        effort_si = homing.stop_current_a * constant * effort_per_motor_nm(drive)
        efforts.append(("stop_current_a", homing.stop_current_a, effort_si))
    return efforts
