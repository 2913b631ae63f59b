import math
from dataclasses import replace
from functools import cache

import msgspec
import pytest
from drive_files import (
    HIP_LIMITS,
    PROFILES,
    SLIDE_LIMITS,
    axis_for,
    drive,
    drive_of,
    join,
    table,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from drives.cia402.homing import Homing
from drives.cia402.torque import RatedTorqueUnit, count_nm
from drives.cia402.units import (
    DriveBase,
    DriveLimits,
    RawHoming,
    RawLimits,
    axis_scaling,
    base_from_raw,
    effort_to_permille,
    expected_base,
    permille_to_effort,
    position_si,
    position_to_counts,
    raw_homing,
    raw_limits,
    to_joint,
)
from drives.errors import CommandNotFinite
from drives.signals import DriveFeedback, Input, NmtState, PowerState

WIDE = "wide"
"""A target in the upper half of 32 bits, as of Technosoft's iPOS with 20 A peak."""
NAMES = [f"{joint}_{profile}" for joint in ("hip", "slide") for profile in (*PROFILES, WIDE)]
"""The trainer's joints with every profile, and with one whose target has 32 bits."""
FEEDBACK = DriveFeedback(
    node_id=5,
    nmt_state=NmtState.OPERATIONAL,
    power_state=PowerState.OPERATION_ENABLED,
    statusword=0x1637,
    following=True,
    warning=False,
    mode_display=10,
    position_counts=0,
    torque_raw=0,
    inputs=Input.NONE,
    temperature_degc=None,
    fresh=True,
    sample_age_cycles=0,
    late_count=0,
    heartbeat_age_ns=0,
    rebooted=False,
    emergency=None,
    emergency_count=0,
    protocol_error_count=0,
)


@cache
def described(name):
    joint, _, profile = name.partition("_")
    if profile != WIDE:
        return drive_of(profile, joint)
    kind = table("profiles/generic.toml")
    kind["target_torque"] |= {"bits": 32, "unit": "ampere", "factor": 2 * 20 / 65520 / 65536}
    return join(axis_for(kind, joint), kind, joint)


@cache
def scaling(name):
    description = described(name)
    return axis_scaling(description, expected_base(description))


def test_one_turn_of_the_motor_is_one_hundredth_of_a_turn_of_the_hip():
    assert position_si(1024, scaling("hip_epos4")) == pytest.approx(2 * math.pi / 100)


def test_the_slide_travels_its_lead_per_turn_after_the_gear_against_the_counts():
    assert position_si(-512 * 6, scaling("slide_epos4")) == pytest.approx(0.15)


def test_motor_current_becomes_torque_by_torque_constant_and_gear_alone():
    sample = to_joint(FEEDBACK._replace(torque_raw=1000), scaling("hip_epos4"))

    assert sample.effort_si == pytest.approx(0.055736 * 100)  # 1 A, no efficiency factor


def test_motor_current_becomes_force_by_lead_and_sign():
    sample = to_joint(FEEDBACK._replace(torque_raw=1000), scaling("slide_epos4"))

    assert sample.effort_si == pytest.approx(-0.107746 * 6 * 2 * math.pi / 0.15)


def test_effort_is_positive_when_it_accelerates_along_the_positive_axis():
    # Power = effort * speed must be torque at the motor * speed of the motor, whatever the sign.
    for name in NAMES:
        s = scaling(name)
        per_count_si = position_si(1, s) - position_si(0, s)

        assert s.effort_per_torque_count_si * per_count_si > 0


def test_6076_of_an_epos4_is_in_micro_newton_metre():
    # Three public DCFs: 3001h:01 mA x 3001h:05 uNm/A / 1000 = 6076h; 100 per mille is 51.3 mN m.
    description = drive("slide_epos4")
    base = base_from_raw(description, 512_871, 4760, 107_746)

    at_100 = permille_to_effort(100, axis_scaling(description, base))

    motor_nm = abs(at_100) * 0.15 / (2 * math.pi * 6)
    assert motor_nm == pytest.approx(0.0512871)


def test_6076_of_a_cia_402_drive_is_in_milli_newton_metre():
    description = drive("slide_generic")

    assert base_from_raw(description, 646, 6000, None).rated_torque_nm == pytest.approx(0.646)


@pytest.mark.parametrize("axis", ["hip", "slide"])
def test_both_personalities_agree_on_the_same_motor_within_one_percent(axis):
    epos4, generic = scaling(f"{axis}_epos4"), scaling(f"{axis}_generic")
    rated_ma = drive(f"{axis}_epos4").axis.motor.rated_current_raw

    by_current = rated_ma * epos4.effort_per_torque_count_si
    by_permille = 1000 * generic.effort_per_torque_count_si

    assert by_permille == pytest.approx(by_current, rel=0.01)


def test_a_drive_without_a_torque_constant_object_uses_the_axis_file_s():
    base = expected_base(drive("hip_generic"))

    assert base.torque_constant_nm_per_a == 0.055736


@settings(derandomize=True)
@given(counts=st.integers(-(2**31) + 1, 2**31 - 1))
def test_a_position_comes_back_as_the_same_count(counts):
    for name in NAMES:
        s = scaling(name)

        assert position_to_counts(position_si(counts, s), s) == counts, name


@settings(derandomize=True)
@given(permille=st.integers(-32767, 32767))
def test_an_effort_comes_back_as_the_same_permille(permille):
    for name in NAMES:
        s = scaling(name)

        assert effort_to_permille(permille_to_effort(permille, s), s) == permille, name


@settings(derandomize=True)
@given(effort=st.floats(allow_nan=False, allow_infinity=False))
def test_a_large_effort_is_clipped_and_never_wraps(effort):
    for name in NAMES:
        s = scaling(name)

        target = effort_to_permille(effort, s)

        largest = 2**31 - 1 if WIDE in name else 2**15 - 1
        assert -largest <= target <= largest, name
        assert target == 0 or (target > 0) == (effort * s.permille_per_effort_si > 0), name


@settings(derandomize=True)
@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_more_effort_never_asks_for_less(one, other):
    less, more = sorted((one, other))
    for name in NAMES:
        s = scaling(name)

        step = effort_to_permille(more, s) - effort_to_permille(less, s)

        assert step * s.permille_per_effort_si >= 0, name


@settings(derandomize=True)
@given(raw=st.integers(-32767, 32767))
def test_a_sample_is_proportional_to_its_raw_value_and_has_the_sign_of_the_joint(raw):
    for name in NAMES:
        s = scaling(name)

        effort = to_joint(FEEDBACK._replace(torque_raw=raw), s).effort_si

        assert effort == pytest.approx(raw * s.effort_per_torque_count_si), name
        assert raw == 0 or (effort > 0) == (raw * s.counts_per_si > 0), name


@settings(derandomize=True)
@given(effort=st.floats(0.1, 1e9), current_a=st.floats(6.0, 400.0))
def test_a_limit_is_never_wider_than_joint_and_motor_and_always_fits_its_object(effort, current_a):
    for name in NAMES:
        description = described(name)
        motor = msgspec.structs.replace(description.axis.motor, current_limit_a=current_a)
        strong = replace(description, axis=msgspec.structs.replace(description.axis, motor=motor))
        limits = (HIP_LIMITS if "hip" in name else SLIDE_LIMITS)._replace(effort_max_si=effort)

        raw = raw_limits(limits, strong).torque_raw

        limit = description.profile.torque_limit
        per_motor_nm = math.tau * description.axis.transmission.revs_per_si
        effort_of_raw = raw * count_nm(limit, expected_base(strong)) * per_motor_nm
        motor_effort = current_a * motor.torque_constant_nm_per_a * per_motor_nm
        assert 1 <= raw < 2 ** (limit.bits - limit.signed), name
        assert raw == 1 or effort_of_raw <= min(effort, motor_effort) * (1 + 1e-9), name


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_never_turned_into_a_number(value, name):
    s = scaling(name)

    with pytest.raises(CommandNotFinite, match="effort"):
        effort_to_permille(value, s)
    with pytest.raises(CommandNotFinite, match="position"):
        position_to_counts(value, s)


def test_what_is_asked_is_what_the_drive_then_reports():
    # Torque by 6071h acts as current = torque / k_t; read back in mA it is the same effort.
    description = drive("hip_epos4")
    base = DriveBase(rated_torque_nm=0.280, rated_current_a=5.0, torque_constant_nm_per_a=0.056)
    s = axis_scaling(description, base)

    permille = effort_to_permille(12.0, s)
    current_ma = permille / 1000 * 0.280 / 0.056 * 1000

    assert current_ma * s.effort_per_torque_count_si == pytest.approx(12.0, abs=0.02)


# --- limits ---------------------------------------------------------------------------------------


def test_limits_are_rounded_to_the_careful_side():
    raw = raw_limits(HIP_LIMITS, drive("hip_epos4"))
    s = scaling("hip_epos4")

    assert position_si(raw.position_min_counts, s) >= HIP_LIMITS.position_min_si
    assert position_si(raw.position_max_counts, s) <= HIP_LIMITS.position_max_si
    assert raw.following_error_counts <= 0.2 * s.counts_per_si
    assert raw.deceleration_raw >= 20.0 * s.speed_counts_per_si


def test_a_sign_of_minus_one_does_not_turn_the_position_limits_around():
    raw = raw_limits(SLIDE_LIMITS, drive("slide_epos4"))

    assert raw.position_min_counts == -12288  # 0.6 m
    assert raw.position_max_counts == -410  # 0.02 m, 409.6 counts, rounded inwards


@pytest.mark.parametrize(
    ("speed", "deceleration", "per_rev", "per_rev_s"),
    [
        ("rpm", "rpm_per_s", 60, 60),
        ("counts_per_s", "counts_per_s2", 1024, 1024),
        ("tenth_counts_per_s", "ten_counts_per_s2", 10_240, 102.4),  # Copley
    ],
)
def test_speeds_and_ramps_are_in_the_units_of_the_profile(speed, deceleration, per_rev, per_rev_s):
    kind = table("profiles/generic.toml")
    kind |= {"velocity_unit": speed, "deceleration_unit": deceleration}

    raw = raw_limits(HIP_LIMITS, join(axis_for(kind), kind, "hip"))

    assert raw.speed_raw == math.floor(3.0 / (2 * math.pi) * 100 * per_rev)
    assert raw.deceleration_raw == math.ceil(20.0 / (2 * math.pi) * 100 * per_rev_s)


def test_speeds_are_in_the_drive_s_own_unit():
    epos4 = raw_limits(HIP_LIMITS, drive("hip_epos4"))
    generic = raw_limits(HIP_LIMITS, drive("hip_generic"))

    assert epos4.speed_raw == math.floor(3.0 / (2 * math.pi) * 100 * 60)  # rpm
    assert generic.speed_raw == math.floor(3.0 / (2 * math.pi) * 100 * 1024)  # counts/s


def test_the_torque_limit_is_the_smaller_of_joint_and_motor():
    by_joint = raw_limits(HIP_LIMITS, drive("hip_epos4"))
    by_motor = raw_limits(HIP_LIMITS._replace(effort_max_si=500.0), drive("hip_epos4"))

    assert by_joint.torque_raw == math.floor(60.0 / (0.055736 * 100) * 1000)  # mA
    assert by_motor.torque_raw == 12_000


def test_the_torque_limit_of_a_cia_402_drive_is_in_permille():
    raw = raw_limits(HIP_LIMITS, drive("hip_generic"))

    assert raw.torque_raw == math.floor(60.0 / 100 / 0.279 * 1000)


@pytest.mark.parametrize(
    ("rated_torque_raw", "rated_current_raw", "torque_nm", "current_a"),
    [(None, None, 5.0 * 0.055736, 5.0), (None, 6000, 6.0 * 0.055736, 6.0), (300, None, 0.3, 5.0)],
)
def test_what_a_drive_does_not_hold_is_taken_from_the_axis_file(
    rated_torque_raw, rated_current_raw, torque_nm, current_a
):
    base = base_from_raw(drive("hip_generic"), rated_torque_raw, rated_current_raw, None)

    assert base.rated_torque_nm == pytest.approx(torque_nm)
    assert base.rated_current_a == pytest.approx(current_a)


# --- by hand --------------------------------------------------------------------------------------


def by_hand(sign=-1, *, signed=False, current_limit_a=20.0):
    """A slide of 4 turns and 4000 counts per m, with 5 N m at 1000 per mille, at 0.25 m."""
    description, change = drive("slide_generic"), msgspec.structs.replace
    transmission = change(
        description.axis.transmission,
        gear_ratio=2.0,
        lead_m=0.5,
        sign=sign,
        counts_per_rev=1000,
        offset_m=0.25,
    )
    motor = change(
        description.axis.motor,
        torque_constant_nm_per_a=0.5,
        nominal_current_a=10.0,
        current_limit_a=current_limit_a,
        rated_torque_raw=5000,
    )
    limit = change(description.profile.torque_limit, signed=signed)
    return replace(
        description,
        axis=change(description.axis, transmission=transmission, motor=motor),
        profile=change(description.profile, torque_limit=limit),
    )


PER_NM = 4 * math.tau
LIMITS = DriveLimits(0.5, 1.5, 0.5, 2.0 * PER_NM, 0.0025, 2.0)
RAW = RawLimits(-5000, -1000, 2000, 400, 10, 8000)


@pytest.mark.parametrize("sign", [-1, 1])
def test_an_offset_is_the_position_at_count_zero(sign):
    s = axis_scaling(by_hand(sign), expected_base(by_hand(sign)))

    assert position_si(0, s) == 0.25
    assert position_si(sign * 4000, s) == 1.25
    assert position_to_counts(1.25, s) == sign * 4000
    assert position_to_counts(0.25, s) == 0
    assert effort_to_permille(PER_NM, s) == sign * 200


def test_limits_are_written_as_integers_of_the_drive_s_units():
    other_way = RAW._replace(position_min_counts=1000, position_max_counts=5000)

    assert raw_limits(LIMITS, by_hand()) == RAW
    assert raw_limits(LIMITS, by_hand(1)) == other_way


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"position_min_si": -math.inf}, {"position_max_counts": 2**31 - 1}),
        ({"position_max_si": math.inf}, {"position_min_counts": 1 - 2**31}),
        ({"velocity_max_si": 1e-9}, {"speed_raw": 1}),
        ({"velocity_max_si": 1e9}, {"speed_raw": 2**32 - 1}),
        # a limit below, a ramp above; a rounding error is neither
        ({"velocity_max_si": 0.500_2}, {"speed_raw": 2000}),
        ({"velocity_max_si": 0.499_999_999_9}, {"speed_raw": 2000}),
        ({"velocity_max_si": 0.499_99}, {"speed_raw": 1999}),
        ({"quick_stop_deceleration_si_per_s2": 2.000_000_000_1}, {"deceleration_raw": 8000}),
        ({"quick_stop_deceleration_si_per_s2": 2.000_01}, {"deceleration_raw": 8001}),
        ({"quick_stop_deceleration_si_per_s2": 1.999_9}, {"deceleration_raw": 8000}),
        ({"quick_stop_deceleration_si_per_s2": 0.0}, {"deceleration_raw": 1}),
        ({"quick_stop_deceleration_si_per_s2": 1e9}, {"deceleration_raw": 2**32 - 1}),
        ({"following_error_si": 0.0}, {"following_error_counts": 1}),
        ({"following_error_si": 1e9}, {"following_error_counts": 2**32 - 1}),
        ({"effort_max_si": 0.0}, {"torque_raw": 1}),
        ({"effort_max_si": 1e9}, {"torque_raw": 2000}),  # 20 A * 0.5 N m/A
    ],
)
def test_a_limit_beyond_what_its_object_holds_is_the_nearest_that_it_holds(change, expected):
    assert raw_limits(LIMITS._replace(**change), by_hand()) == RAW._replace(**expected)


@pytest.mark.parametrize(("signed", "largest"), [(False, 2**16 - 1), (True, 2**15 - 1)])
def test_a_torque_limit_has_the_bits_of_its_object_without_its_sign(signed, largest):
    strong = by_hand(signed=signed, current_limit_a=1e9)

    assert raw_limits(LIMITS._replace(effort_max_si=1e12), strong).torque_raw == largest


def test_an_effort_and_a_position_beyond_all_bounds_are_the_largest_numbers():
    narrow, wide = scaling("hip_generic"), scaling(f"hip_{WIDE}")

    for sign in (-1, 1):
        assert effort_to_permille(sign * 1e300, narrow) == sign * (2**15 - 1)
        assert effort_to_permille(sign * 1e300, wide) == sign * (2**31 - 1)
        assert position_to_counts(sign * 1e300, narrow) == sign * (2**31 - 1)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_homing_is_in_whole_units_and_at_least_one(sign):
    homing = Homing(
        method=17,
        home_si=0.75,
        search_speed_si_per_s=0.0105,
        zero_speed_si_per_s=0.0025,
        acceleration_si_per_s2=0.126,
        effort_max_si=10.0,
        timeout_s=10.0,
    )
    slow = msgspec.structs.replace(
        homing,
        search_speed_si_per_s=1e-6,
        zero_speed_si_per_s=1e-6,
        acceleration_si_per_s2=1e-6,
        stop_current_a=1.2345,
    )

    assert raw_homing(homing, sign, by_hand()) == RawHoming(-2000 * sign, 42, 10, 504, None)
    assert raw_homing(slow, sign, by_hand()) == RawHoming(-2000 * sign, 1, 1, 1, 1234)


def test_a_base_in_newton_is_that_of_a_linear_motor_and_a_constant_is_in_millionths():
    description, change = by_hand(), msgspec.structs.replace
    base = change(description.profile.torque_base, rated_torque_unit=RatedTorqueUnit.MILLI_NEWTON)
    linear = replace(description, profile=change(description.profile, torque_base=base))

    assert base_from_raw(linear, 5000, 7000, 300_000) == pytest.approx(
        DriveBase(5.0 / PER_NM, 7.0, 0.3)
    )
    assert base_from_raw(linear, None, None, None) == DriveBase(5.0, 10.0, 0.5)
    assert expected_base(description).rated_torque_nm == 5.0
