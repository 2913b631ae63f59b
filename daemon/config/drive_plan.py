"""Converts limits.toml and cycle settings into the values that bring-up writes into the drives."""

import math

from gaitd_toml import COMMAND_LINE, ConfigError

from daemon.config.bundle import Settings
from daemon.config.limit_settings import Limits
from daemon.config.settings import Cycle
from drives.bringup.plan import CycleSettings, DrivePlan, plan
from drives.cia402.profile import DriveDescription
from drives.cia402.units import DriveLimits, axis_scaling, expected_base


def drive_limits(limits: Limits) -> tuple[DriveLimits, DriveLimits]:
    """Limits of hip (rad, N m) and slide (m, N) that are written into the drives and read back."""
    hip, slide = limits.hip, limits.slide
    return (
        DriveLimits(
            position_min_si=math.radians(hip.position_min_deg),
            position_max_si=math.radians(hip.position_max_deg),
            velocity_max_si=hip.velocity_max_rad_per_s,
            effort_max_si=hip.torque_max_nm,
            following_error_si=math.radians(hip.following_error_deg),
            quick_stop_deceleration_si_per_s2=hip.quick_stop_deceleration_rad_per_s2,
        ),
        DriveLimits(
            position_min_si=slide.position_min_m,
            position_max_si=slide.position_max_m,
            velocity_max_si=slide.velocity_max_m_per_s,
            effort_max_si=slide.force_max_n,
            following_error_si=slide.following_error_m,
            quick_stop_deceleration_si_per_s2=slide.quick_stop_deceleration_m_per_s2,
        ),
    )


def cycle_settings(cycle: Cycle) -> CycleSettings:
    """Cycle and timeouts that bring-up writes into the drives."""
    return CycleSettings(
        period_ms=cycle.period_ms,
        master_node_id=cycle.master_node_id,
        drive_heartbeat_ms=cycle.drive_heartbeat_ms,
        drive_detection_ms=cycle.drive_detection_ms,
        rpdo_timeout_ms=cycle.rpdo_timeout_ms,
        sync_counter=cycle.sync_counter,
        sync_window_us=round(cycle.sync_window_ms * 1e3),
    )


def effort_per_motor_nm(description: DriveDescription) -> float:
    """Effort at the joint (N m or N) per N m at the motor, without its sign."""
    counts_per_si = axis_scaling(description, expected_base(description)).counts_per_si
    return math.tau * abs(counts_per_si) / description.axis.transmission.counts_per_rev


def plan_of(name: str, settings: Settings) -> DrivePlan:
    """Return the bring-up plan of the drive with a name or node id of the command line.

    Raises:
        ConfigError: no drive has that name or node id; the text lists the known ones.
    """
    hip, slide = drive_limits(settings.limits)
    for leg in settings.legs:
        for drive, limits in ((leg.hip, hip), (leg.slide, slide)):
            if name in (drive.name, str(drive.node_id)):
                return plan(drive, limits, cycle_settings(settings.trainer.cycle))
    known = ", ".join(f"{drive.name} (node {drive.node_id})" for drive in settings.drives)
    raise ConfigError(COMMAND_LINE, "NAME", name, f"a drive of {settings.file.path}: {known}")
