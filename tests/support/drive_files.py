"""The drives of configs/drives/, as tests need them, and limits that fit them."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from drives.bringup.plan import CycleSettings
from drives.cia402.axis_file import AxisFile
from drives.cia402.profile import DriveDescription, DriveProfile, describe
from drives.cia402.units import DriveLimits

FOLDER = Path(__file__).resolve().parents[2] / "configs" / "drives"
TRACES = Path(__file__).resolve().parents[1] / "traces"

CYCLE = CycleSettings(
    period_ms=10,
    master_node_id=1,
    drive_heartbeat_ms=20,
    drive_detection_ms=100,
    rpdo_timeout_ms=30,
)
HIP_LIMITS = DriveLimits(
    position_min_si=-0.3,
    position_max_si=1.2,
    velocity_max_si=3.0,
    effort_max_si=60.0,
    following_error_si=0.2,
    quick_stop_deceleration_si_per_s2=20.0,
)
SLIDE_LIMITS = DriveLimits(
    position_min_si=0.02,
    position_max_si=0.6,
    velocity_max_si=1.5,
    effort_max_si=500.0,
    following_error_si=0.05,
    quick_stop_deceleration_si_per_s2=20.0,
)


def table(name: str) -> dict[str, Any]:
    """One TOML file as plain tables, for tests that break it."""
    return tomllib.loads((FOLDER / name).read_text(encoding="utf-8"))


AXES = sorted(file.stem for file in FOLDER.glob("*.toml"))
"""Every axis file: hip_epos4, slide_epos4, ..."""
PROFILES = sorted(file.stem for file in (FOLDER / "profiles").glob("*.toml"))
"""Every profile: epos4, generic, ..."""


@cache
def drive(name: str = "hip_epos4") -> DriveDescription:
    """One of `AXES`."""
    return join(table(f"{name}.toml"), table(table(f"{name}.toml")["profile"]), name)


def axis_for(profile: dict[str, Any], joint: str = "hip") -> dict[str, Any]:
    """The trainer's hip or slide with the drive of a profile: the motor data that it would hold."""
    axis = table(f"{joint}_generic.toml")
    motor, base = axis["motor"], profile["torque_base"]
    torque_nm = motor["torque_constant_nm_per_a"] * motor["nominal_current_a"]
    count_nm = {"micro_newton_metre": 1e-6, "milli_newton_metre": 1e-3}
    for name in ("rated_torque", "rated_current"):
        del motor[f"{name}_raw"]
    if "rated_torque" in base:
        motor["rated_torque_raw"] = round(torque_nm / count_nm[base["rated_torque_unit"]])
    if "rated_current" in base:
        motor["rated_current_raw"] = round(motor["nominal_current_a"] * 1e3)
    if "torque_constant" in base:
        motor["torque_constant_raw"] = round(motor["torque_constant_nm_per_a"] * 1e6)
    return axis


@cache
def drive_of(profile: str, joint: str = "hip") -> DriveDescription:
    """The trainer's hip or slide with the drive of one of `PROFILES`."""
    kind = table(f"profiles/{profile}.toml")
    return join(axis_for(kind, joint), kind, joint)


def join(axis: dict[str, Any], profile: dict[str, Any], name: str) -> DriveDescription:
    """Tables to a description, refused as the service refuses them."""
    axis_file = msgspec.convert(axis, AxisFile)
    eds = str(FOLDER / axis_file.eds)
    kind = msgspec.convert(profile, DriveProfile)
    return describe(f"right/{name.partition('_')[0]}", kind, axis_file, eds)
