"""Bring-up of one axis that is moved alone: homed, or pushed a little to prove its sign.

As `plan.py`, with a torque limit of its own in the drive, and without position limits: the axis may
not know where it is.
"""

import math
from collections.abc import Iterator
from typing import Final

from drives.plan import CycleSettings, DrivePlan, Step, StepKind, plan, setting
from drives.profile import DriveDescription
from drives.units import DriveLimits, raw_homing

_HOMING_MODE: Final = 1 << 5
"""Bit of 6502h."""


def homing_plan(
    description: DriveDescription, limits: DriveLimits, cycle: CycleSettings
) -> DrivePlan:
    """As `plan`, with what a homing needs, and with the axis file's torque limit for it."""
    homing = description.axis.homing
    if homing is None:
        raise ValueError(f"{description.name} has no homing")
    usual = lonely_plan(description, limits, cycle, homing.effort_max_si)
    seeds = next(n for n, step in enumerate(usual.steps) if step.kind is StepKind.SEED_POSITION)
    steps = (*usual.steps[:seeds], *_homing(description), *usual.steps[seeds:])
    return DrivePlan(description, steps)


def lonely_plan(
    description: DriveDescription, limits: DriveLimits, cycle: CycleSettings, effort_max_si: float
) -> DrivePlan:
    """As `plan` for an axis that is moved alone, by little: at most this effort, N·m or N."""
    lonely = limits._replace(
        position_min_si=-math.inf, position_max_si=math.inf, effort_max_si=effort_max_si
    )
    return plan(description, lonely, cycle)


def _homing(description: DriveDescription) -> Iterator[Step]:
    objects, homing = description.profile.homing, description.axis.homing
    if objects is None or homing is None:
        return
    raw = raw_homing(homing, objects.home_sign, description)
    bit = _HOMING_MODE
    yield Step(StepKind.CHECK, "it knows homing", 0x6502, value=bit, mask=bit, is_hex=True)
    speed = description.profile.velocity_unit.value
    yield setting("homing method", 0x6098, 0, 8, homing.method)
    yield setting(f"homing: search speed in {speed}", 0x6099, 1, 32, raw.search_speed_raw)
    yield setting(
        f"homing: speed for the exact place in {speed}", 0x6099, 2, 32, raw.zero_speed_raw
    )
    yield setting(f"homing: acceleration in {speed} per s", 0x609A, 0, 32, raw.acceleration_raw)
    home, threshold = objects.home, objects.current_threshold
    yield setting("position at home in counts", home.index, home.sub, home.bits, raw.home_raw)
    if threshold is not None and raw.stop_current_ma is not None:
        why = "current in mA that means the mechanical stop"
        yield setting(why, threshold.index, threshold.sub, threshold.bits, raw.stop_current_ma)
