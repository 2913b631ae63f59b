"""The drives of configs/drives/, as tests need them, and limits that fit them."""

import tomllib
from pathlib import Path
from typing import Any

import msgspec

from drives.axis_file import AxisFile
from drives.plan import CycleSettings
from drives.profile import DriveDescription, DriveProfile, describe
from drives.units import DriveLimits

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


def drive(name: str = "hip_epos4") -> DriveDescription:
    """One of hip_epos4, slide_epos4, hip_generic, slide_generic."""
    return join(table(f"{name}.toml"), table(table(f"{name}.toml")["profile"]), name)


def join(axis: dict[str, Any], profile: dict[str, Any], name: str) -> DriveDescription:
    """Tables to a description, refused as the service refuses them."""
    axis_file = msgspec.convert(axis, AxisFile)
    eds = str(FOLDER / axis_file.eds)
    kind = msgspec.convert(profile, DriveProfile)
    return describe(f"right/{name.partition('_')[0]}", kind, axis_file, eds)
