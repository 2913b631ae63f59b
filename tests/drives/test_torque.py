"""Golden numbers: what one drive's raw value is at the motor, by hand, from the rule that is cited.

Rules and their sources stand in the profiles (`sources`) and in `drives/cia402/torque.py`.
"""

import math

import msgspec
import pytest
from drive_files import HIP_LIMITS, PROFILES, axis_for, drive_of, join, table

from drives.cia402.torque import (
    DriveBase,
    ObjectRef,
    RatedTorqueUnit,
    TorqueBase,
    TorqueObject,
    TorqueSampling,
    TorqueUnit,
    Word,
    base_in_words,
    check_bases,
    count_nm,
)
from drives.cia402.units import axis_scaling, base_from_raw, permille_to_effort, raw_limits
from drives.errors import DescriptionError

HIP_K_T = 0.055736  # N m/A, of the hip's motor
HIP_RATED_A = 5.0


def base_of(description, **raw):
    """What the drive would hold: the axis file's integers, with some of them changed."""
    motor = description.axis.motor
    names = ("rated_torque_raw", "rated_current_raw", "torque_constant_raw")
    values = {name: getattr(motor, name) for name in names} | raw
    return base_from_raw(description, *(values[name] for name in names))


# profile, object, what the drive holds, raw value, N m at the motor
GOLDEN = [
    # EPOS4 30D1h:02: mA x 3001h:05 in uNm/A. The three public DCFs: 512871, 137261, 4793 uNm.
    ("epos4", "torque_source", {"torque_constant_raw": 107_746}, 4760, 0.512_870_96),
    ("epos4", "torque_source", {"torque_constant_raw": 18_675}, 7350, 0.137_261_25),
    ("epos4", "torque_source", {"torque_constant_raw": 55_736}, 86, 0.004_793_296),
    ("epos4", "torque_limit", {"torque_constant_raw": 55_736}, 12_000, 0.668_832),
    # EPOS4 6071h: per mille of 6076h, which is in uNm: 51.3 mNm, and not 51.3 Nm.
    ("epos4", "target_torque", {"rated_torque_raw": 512_871}, 100, 0.051_287_1),
    # CiA 402: per mille of 6076h in mNm.
    ("generic", "torque_source", {"rated_torque_raw": 279}, 500, 0.139_5),
    ("generic", "torque_limit", {"rated_torque_raw": 279}, 2000, 0.558),
    ("generic", "target_torque", {"rated_torque_raw": 513}, 100, 0.051_3),
    # Elmo Gold: per mille of 6075h in mA, times the motor's k_t.
    ("elmo_gold", "torque_source", {"rated_current_raw": 5000}, 333, 0.333 * 5.0 * HIP_K_T),
    ("elmo_gold", "torque_limit", {"rated_current_raw": 5000}, 2400, 12.0 * HIP_K_T),
    ("elmo_gold", "target_torque", {"rated_current_raw": 5000}, -1000, -5.0 * HIP_K_T),
    # Nanotec: per mille of the torque that the rated current 203Bh:01 in mA makes.
    ("nanotec_cl4e", "torque_source", {"rated_current_raw": 5000}, 500, 2.5 * HIP_K_T),
    ("nanotec_cl4e", "torque_limit", {"rated_current_raw": 5000}, 1100, 5.5 * HIP_K_T),
    ("nanotec_cl4e", "target_torque", {"rated_current_raw": 5000}, 500, 2.5 * HIP_K_T),
]


@pytest.mark.parametrize(("profile", "object_", "holds", "raw", "nm"), GOLDEN)
def test_a_raw_value_is_the_torque_that_its_maker_says(profile, object_, holds, raw, nm):
    description = drive_of(profile)
    torque = getattr(description.profile, object_)

    assert raw * count_nm(torque, base_of(description, **holds)) == pytest.approx(nm, rel=1e-9)


def test_every_profile_has_golden_numbers_for_each_of_its_torque_objects():
    told = {(profile, object_) for profile, object_, *_ in GOLDEN}

    assert told == {
        (profile, object_)
        for profile in PROFILES
        for object_ in ("torque_source", "torque_limit", "target_torque")
    }


def torque_object(unit, factor):
    return TorqueObject(index=0x6077, sub=0, bits=16, signed=True, unit=unit, factor=factor)


@pytest.mark.parametrize(
    ("unit", "factor", "raw", "ampere"),
    [
        # Technosoft iPOS, 20 A peak: counts of 2 I_peak / 65520 (yarp-devices, TechnosoftIpos)
        (TorqueUnit.AMPERE, 2 * 20 / 65520, 8190, 5.0),
        # Kinco: 45 sqrt 2 counts per ampere (CANOpenRobotController, its robot M1)
        (TorqueUnit.AMPERE, 1 / (45 * math.sqrt(2)), 45, math.sqrt(0.5)),
        # an object in 0.01 A
        (TorqueUnit.MILLIAMPERE, 10.0, 500, 5.0),
        # Beckhoff EL72x1: per mille of a peak rated current, k_t per A rms (2002h:54 = 0)
        (TorqueUnit.PERMILLE_OF_RATED_CURRENT, math.sqrt(0.5), 1000, HIP_RATED_A / math.sqrt(2)),
        # Schunk, PRBT, Beckhoff with the rms option: per mille of the rated current
        (TorqueUnit.PERMILLE_OF_RATED_CURRENT, 1.0, 1000, HIP_RATED_A),
    ],
)
def test_a_vendor_s_count_of_current_is_a_factor_of_a_unit(unit, factor, raw, ampere):
    base = DriveBase(0.0, HIP_RATED_A, HIP_K_T)

    assert raw * count_nm(torque_object(unit, factor), base) == pytest.approx(ampere * HIP_K_T)


def test_a_rated_force_in_millinewton_is_that_of_a_linear_motor():
    # 60 N at 1000 per mille; the motor's "revolution" is 30 mm of magnets.
    profile = table("profiles/generic.toml")
    profile["torque_base"]["rated_torque_unit"] = "milli_newton"
    axis = table("slide_generic.toml")
    axis["transmission"] |= {"gear_ratio": 1.0, "lead_m": 0.03, "sign": 1}
    axis["motor"] |= {
        "torque_constant_nm_per_a": 12.0 * 0.03 / (2 * math.pi),  # 12 N/A
        "nominal_current_a": 5.0,
        "current_limit_a": 10.0,
        "rated_torque_raw": 60_000,
        "rated_current_raw": 5000,
    }
    description = join(axis, profile, "slide")

    scaling = axis_scaling(description, base_of(description))

    assert 1000 * scaling.effort_per_torque_count_si == pytest.approx(60.0)
    assert permille_to_effort(500, scaling) == pytest.approx(30.0)


@pytest.mark.parametrize(
    "change", [{"gear_ratio": 6.0}, {"gear_ratio": 0.5}, {"kind": "rotary", "gear_ratio": 1.0}]
)
def test_a_rated_force_needs_a_linear_motor_without_a_gear(change):
    profile = table("profiles/generic.toml")
    profile["torque_base"]["rated_torque_unit"] = "milli_newton"
    axis = table("hip_generic.toml" if "kind" in change else "slide_generic.toml")
    axis["transmission"] |= change

    with pytest.raises(DescriptionError) as caught:
        join(axis, profile, "slide")

    kind = axis["transmission"]["kind"]
    allowed = "linear, with gear_ratio = 1: the profile's 6076h is a force"
    assert str(caught.value) == f"axis: transmission.kind = {kind!r}: {allowed}"


def test_the_drive_s_own_base_counts_and_not_the_file_s():
    description = drive_of("elmo_gold")

    by_file = axis_scaling(description, base_of(description))
    by_drive = axis_scaling(description, base_of(description, rated_current_raw=5040))

    ratio = by_drive.effort_per_torque_count_si / by_file.effort_per_torque_count_si
    assert ratio == pytest.approx(5040 / 5000)


def test_a_drive_that_counts_torque_the_other_way_is_turned_around_once():
    profile = table("profiles/generic.toml")
    profile["torque_source"]["sign"] = -1
    turned = join(axis_for(profile), profile, "hip")

    scaling = axis_scaling(turned, base_of(turned))
    plain = axis_scaling(drive_of("generic"), base_of(drive_of("generic")))

    assert scaling.effort_per_torque_count_si == -plain.effort_per_torque_count_si
    assert scaling.permille_per_effort_si == plain.permille_per_effort_si
    assert scaling.counts_per_si == plain.counts_per_si


@pytest.mark.parametrize(
    ("unit", "missing"),
    [
        (TorqueUnit.PERMILLE_OF_RATED_TORQUE, "torque_base.rated_torque"),
        (TorqueUnit.PERMILLE_OF_RATED_CURRENT, "torque_base.rated_current"),
    ],
)
def test_a_unit_without_the_object_that_it_refers_to_is_refused(unit, missing):
    with pytest.raises(DescriptionError) as caught:
        check_bases({"torque_limit": torque_object(unit, 1.0)}, TorqueBase())

    assert (caught.value.part, caught.value.key) == ("profile", missing)
    assert "torque_limit.unit" in caught.value.allowed


@pytest.mark.parametrize("unit", [TorqueUnit.MILLIAMPERE, TorqueUnit.AMPERE])
def test_a_current_needs_no_object_since_the_sheet_has_the_torque_constant(unit):
    check_bases({"torque_source": torque_object(unit, 1.0)}, TorqueBase())

    assert base_in_words(torque_object(unit, 1.0), TorqueBase()) == "k_t of the axis file"


def test_an_object_holds_the_values_of_its_bits():
    objects = [ObjectRef(index=1, sub=0, bits=8, signed=signed) for signed in (True, False)]

    assert [one.values for one in objects] == [range(-128, 128), range(256)]
    words = "which 0001h:00 can hold"
    assert [one.values_in_words for one in objects] == [
        f"-128 to 127, {words}",
        f"0 to 255, {words}",
    ]


@pytest.mark.parametrize(
    ("value", "fits"),
    [(-0x80000001, False), (-0x80000000, True), (0xFFFFFFFF, True), (0x100000000, False)],
)
def test_a_word_is_of_32_bits_with_or_without_sign(value, fits):
    if fits:
        assert msgspec.convert(value, Word) == value
    else:
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert(value, Word)


RATED_TORQUE = ObjectRef(index=0x6076, sub=0, bits=32, signed=False)


@pytest.mark.parametrize(
    ("base", "unit"),
    [
        (TorqueBase(rated_torque=RATED_TORQUE), None),
        (
            TorqueBase(rated_torque_unit=RatedTorqueUnit.MILLI_NEWTON_METRE),
            RatedTorqueUnit.MILLI_NEWTON_METRE,
        ),
    ],
)
def test_a_rated_torque_and_its_unit_come_together(base, unit):
    with pytest.raises(DescriptionError) as caught:
        check_bases({}, base)

    said = caught.value
    assert (said.part, said.key, said.value) == ("profile", "torque_base.rated_torque_unit", unit)
    assert said.allowed == "given if, and only if, torque_base.rated_torque is"


def test_what_a_count_refers_to_is_the_axis_file_s_where_the_drive_has_no_object():
    torque = torque_object(TorqueUnit.PERMILLE_OF_RATED_TORQUE, 1.0)
    current = torque_object(TorqueUnit.PERMILLE_OF_RATED_CURRENT, 1.0)

    assert base_in_words(torque, TorqueBase()) == "rated torque of the axis file"
    assert base_in_words(current, TorqueBase()) == (
        "rated current of the axis file in milliampere, k_t of the axis file"
    )


def test_an_object_has_an_index_and_a_sub_index_of_the_dictionary_and_no_other_key():
    given = {"index": 0x1000, "sub": 0, "bits": 16, "signed": True}

    for change in ({}, {"index": 0xFFFF}, {"sub": 254}):
        assert msgspec.convert(given | change, ObjectRef) == ObjectRef(**(given | change))
    for change in ({"index": 0xFFF}, {"index": 0x10000}, {"sub": -1}, {"sub": 255}, {"unit": 1}):
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert(given | change, ObjectRef)
    assert TorqueUnit("ampere") is TorqueUnit.AMPERE
    assert TorqueSampling("filtered") is TorqueSampling.FILTERED


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, math.inf, 1001.0])
def test_a_factor_that_no_drive_has_is_refused(factor):
    profile = table("profiles/generic.toml")
    profile["torque_source"]["factor"] = factor

    with pytest.raises((msgspec.ValidationError, DescriptionError)):
        join(axis_for(profile), profile, "hip")


@pytest.mark.parametrize("profile", PROFILES)
def test_what_a_count_refers_to_is_told_with_the_objects_that_hold_it(profile):
    description = drive_of(profile)
    words = base_in_words(description.profile.torque_source, description.profile.torque_base)

    told = {
        "epos4": "k_t of 3001h:05",
        "generic": "rated torque of 6076h:00 in milli_newton_metre",
        "elmo_gold": "rated current of 6075h:00 in milliampere, k_t of the axis file",
        "nanotec_cl4e": "rated current of 203Bh:01 in milliampere, k_t of the axis file",
    }
    assert words == told[profile]


def test_a_limit_beyond_the_width_of_its_object_is_the_largest_that_fits():
    # 400 A are 80 times the rated torque; 16 bits hold 65.535 times.
    profile = table("profiles/generic.toml")
    axis = axis_for(profile)
    axis["motor"]["current_limit_a"] = 400.0
    limits = HIP_LIMITS._replace(effort_max_si=1e9)

    assert raw_limits(limits, join(axis, profile, "hip")).torque_raw == 0xFFFF
