"""Limits of an axis: each number comes from the key of its own meaning."""

import math
from itertools import count

import msgspec
import pytest
from msgspec.structs import asdict, replace
from sessions import demo

from daemon.config.edits import replaced
from daemon.config.robot import friction_parameters
from daemon.core.safety.limits import (
    AxisLimits,
    Thresholds,
    axis_limits,
    hip_limits,
    slide_limits,
    thresholds,
)

LIMITS = demo().limits


def numbered(struct, numbers):
    """The same settings with another number for each key, also of the tables in them."""

    def another(old):
        if isinstance(old, msgspec.Struct):
            return numbered(old, numbers)
        return float(next(numbers)) if isinstance(old, float) else old

    return replace(struct, **{key: another(old) for key, old in asdict(struct).items()})


def settings():
    numbers = count(1)
    return replace(
        LIMITS,
        hip=replace(numbered(LIMITS.hip, numbers), brake=True),
        slide=replace(numbered(LIMITS.slide, numbers), brake=False),
        soft_limit=numbered(LIMITS.soft_limit, numbers),
        spasm=numbered(LIMITS.spasm, numbers),
        clonus=numbered(LIMITS.clonus, numbers),
        stop=numbered(LIMITS.stop, numbers),
    )


def key_of(field, axis):
    """The key of limits.toml for a field of `AxisLimits`, without its unit."""
    of_both = {"soft_damping": "damping", "spasm_rise": "rise", "clonus_swing": "swing"}
    name = field.removesuffix("_per_s2").removesuffix("_per_s").removesuffix("_si")
    name = name.removesuffix("_si")
    effort = "torque" if axis == "hip" else "force"
    return of_both.get(name, name.replace("effort", effort))


@pytest.mark.parametrize(("axis", "made_by"), [("hip", hip_limits), ("slide", slide_limits)])
def test_each_limit_is_the_setting_of_its_name_in_si_units(axis, made_by):
    limits = settings()
    tables = (limits, limits.soft_limit, limits.spasm, limits.clonus, limits.stop)
    keys = {
        key: math.radians(value) if key.endswith("_deg") else value
        for table in tables
        for key, value in asdict(getattr(table, axis)).items()
    }

    made = made_by(limits, 0.5)._asdict()

    assert made.pop("breakaway_si") == 0.5
    assert made.pop("enable_max_cycles") == AxisLimits._field_defaults["enable_max_cycles"] == 25
    for field, value in made.items():
        begin = key_of(field, axis)
        named = [key for key in keys if key == begin or key.startswith(f"{begin}_")]
        assert len(named) == 1, (field, named)
        assert value == keys[named[0]], field


def test_a_stuck_axis_is_told_from_the_greatest_friction_along_it():
    slopes = {
        "friction_over_position.hip.slope_per_rad": -0.5,
        "friction_over_position.slide.slope_per_m": 0.5,
    }
    robot = replaced(demo().robot, slopes)

    made = axis_limits(LIMITS, robot)

    low, high = math.radians(LIMITS.hip.position_min_deg), LIMITS.slide.position_max_m
    middle = robot.friction_over_position
    ratios = (1.0 - 0.5 * (low - middle.hip.middle_rad), 1.0 + 0.5 * (high - middle.slide.middle_m))
    for axis, law, ratio in zip(made, friction_parameters(robot), ratios, strict=True):
        viscous = law.viscous * law.peak
        assert axis.breakaway_si == pytest.approx(viscous + ratio * (law.stribeck - viscous))


def test_thresholds_count_in_whole_cycles_and_keep_what_the_file_counts_so():
    begun = replace(
        LIMITS,
        communication=replace(LIMITS.communication, gateway_silence_ms=305),
        watch=replace(LIMITS.watch, energy_window_ms=4005),
        spasm=replace(LIMITS.spasm, patience_ms=405),
        clonus=replace(LIMITS.clonus, patience_ms=1205),
    )

    assert thresholds(begun, 10) == Thresholds(
        sample_age_max_cycles=3,
        heartbeat_timeout_ns=150_000_000,
        gateway_silence_cycles=30,
        overruns_in_a_row=5,
        encoder_frozen_cycles=10,
        encoder_jump_ratio=2.0,
        singularity_stop_ratio=0.15,
        singularity_soft_ratio=0.3,
        deviation_cycles=3,
        sign_mismatch_cycles=3,
        energy_window_cycles=400,
        spasm_patience_cycles=40,
        clonus_patience_cycles=120,
        mode_switch_cycles=5,
    )
