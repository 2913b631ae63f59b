"""`gaitd check` warns of a threshold that its quantity never reaches, and only then."""

import pytest
from config_files import CONFIGS, Change, changed, copied

from daemon.preflight.doubts import doubts
from daemon.preflight.load import read_in_part
from daemon.preflight.thresholds import idle_thresholds

LIMITS = "limits.toml"
EPOS4 = "drives/profiles/epos4.toml"
WRONG_SIGN = "over the gait the {} carries up to {}, and a drive that shows it with the wrong sign"
CROSSES = "at its limit of speed the hip crosses its whole range in 26 cycles"

ROWS = [
    # key, as shipped, the last value that acts, the first that does not, and why
    ("hip.static_load_tolerance_nm", 12.0, 40.7, 40.8, WRONG_SIGN.format("hip", "16.86 N m")),
    ("slide.static_load_tolerance_n", 110.0, 278.0, 279.0, WRONG_SIGN.format("slide", "101.9 N")),
    ("hip.torque_deviation_max_nm", 5.0, 14.9, 15.0, "gives nothing of 15 N m differs by no more"),
    ("hip.load_deviation_max_nm", 8.0, 52.0, 52.5, "at 52.36 N m of guidance the hip has reached"),
    ("slide.load_deviation_max_n", 60.0, 479.0, 480.0, "slide.force_max_n allows guidance no more"),
    ("hip.sign_mismatch_torque_min_nm", 20.0, 26.0, 26.2, "pushes with at most 26.18 N m"),
    ("slide.sign_mismatch_force_min_n", 140.0, 199.0, 200.0, "pushes with at most 200 N"),
    ("hip.power_max_w", 250.0, 272.0, 273.0, "stop the hip at 272.8 W together"),
    ("hip.stride_energy_max_j", 60.0, 142.0, 143.0, "takes 142.8 J"),
    ("slide.assist_power_max_w", 180.0, 524.0, 525.0, "assist_max_n at the limit of speed is 525"),
    ("hip.assist_rate_max_nm_per_s", 200.0, 1999.0, 2000.0, "it allows 20 N m, from limit to"),
    ("spasm.hip.rise_nm", 14.0, 52.0, 52.5, "at 52.36 N m of guidance"),
    ("clonus.hip.swing_nm", 5.0, 52.0, 52.5, "at 52.36 N m of guidance"),
    ("stop.slide.patient_n", 40.0, 0.1, 0.0, "no quick stop is compared with a patient"),
    ("communication.encoder_frozen_cycles", 10, 26, 27, CROSSES),
    ("stop.obey_cycles", 3, 15, 16, "a quick stop of the slide from the highest speed of the gait"),
]
BESIDE = {
    "hip.torque_deviation_max_nm": [Change(LIMITS, "torque_max_nm = 62.0", "torque_max_nm = 15.0")],
    "hip.load_deviation_max_nm": [
        Change(LIMITS, "tracking_max_deg = 20.0", "tracking_max_deg = 10")
    ],
    "hip.assist_rate_max_nm_per_s": [
        Change(LIMITS, "assist_max_nm = 20.0", "assist_max_nm = 10.0"),
    ],
}
"""Other changes, without which the range of the key ends below what its quantity can be."""
BESIDE["spasm.hip.rise_nm"] = BESIDE["hip.load_deviation_max_nm"]
BESIDE["clonus.hip.swing_nm"] = BESIDE["hip.load_deviation_max_nm"]


def warned(tmp_path, *changes):
    """The keys that are warned of, with the reasons."""
    demo = changed(copied(tmp_path), *changes)
    settings, _ = read_in_part(demo)
    return {error.key: error.allowed for error in idle_thresholds(settings)}


@pytest.mark.parametrize(("key", "shipped", "last", "first", "why"), ROWS, ids=str)
def test_a_threshold_that_is_never_reached_is_a_warning_with_its_reason(
    tmp_path, key, shipped, last, first, why
):
    def changes(value):
        name = key.partition(".")[2]
        return [Change(LIMITS, f"{name} = {shipped}", f"{name} = {value}"), *BESIDE.get(key, ())]

    acting = warned(tmp_path / "acting", *changes(last))
    idle = warned(tmp_path / "idle", *changes(first))

    assert key not in acting
    assert idle[key].startswith("its check can no longer act: ")
    assert why in idle[key]


@pytest.mark.parametrize(
    ("changes", "key", "why"),
    [
        (
            [
                Change(LIMITS, "position_min_deg = -20.0", "position_min_deg = 20.0"),
                Change(LIMITS, "tracking_max_deg = 20.0", "tracking_max_deg = 20.1"),
            ],
            "hip.tracking_max_deg",
            "the range of the hip is 20 deg",
        ),
        (
            [
                Change(
                    EPOS4,
                    "sub = 1\nbits = 16\nsigned = true\nmapped",
                    "sub = 1\nbits = 8\nsigned = true\nmapped",
                )
            ],
            "hip.temperature_max_degc",
            "3201h:01 of right/hip holds at most 12.7 degC",
        ),
        (
            [
                Change(LIMITS, "position_min_deg = -20.0", "position_min_deg = 20.0"),
                Change(LIMITS, "encoder_jump_ratio = 2.0", "encoder_jump_ratio = 9.0"),
            ],
            "communication.encoder_jump_ratio",
            "in one cycle it allows the hip a step as long as its whole range",
        ),
        (
            [Change("demo.toml", "hip.load_tolerance_nm = 8.0", "hip.load_tolerance_nm = 34.0")],
            "self_test.hip.load_tolerance_nm",
            "differs by at most 33.72 N m",
        ),
    ],
    ids=["tracking", "temperature", "jump", "self-test"],
)
def test_a_threshold_outside_its_range_or_its_object_is_a_warning(tmp_path, changes, key, why):
    assert why in warned(tmp_path, *changes)[key]


@pytest.mark.parametrize(("slope", "last", "first"), [(1.0, 251.0, 252.0), (-1.0, 315.0, 316.0)])
def test_a_load_that_is_wrong_is_hidden_by_the_friction_of_its_place(tmp_path, slope, last, first):
    rising = Change("robot.toml", "slide.slope_per_m = 0.0", f"slide.slope_per_m = {slope}")
    shipped = "load_tolerance_n = 110.0"

    def keys(name, value):
        tolerance = Change(LIMITS, shipped, f"load_tolerance_n = {value}")
        return warned(tmp_path / name, rising, tolerance)

    assert "slide.static_load_tolerance_n" not in keys("acting", last)
    assert "slide.static_load_tolerance_n" in keys("idle", first)


def test_where_nothing_hangs_on_an_axis_its_effort_limit_is_the_bound(tmp_path):
    configs = copied(tmp_path)
    hil = configs / "hil.toml"
    changed(
        configs, Change("limits_bench.toml", "load_tolerance_nm = 4.0", "load_tolerance_nm = 9.9")
    )

    assert not list(idle_thresholds(read_in_part(hil)[0]))
    changed(
        configs, Change("limits_bench.toml", "load_tolerance_nm = 9.9", "load_tolerance_nm = 10")
    )
    (error,) = idle_thresholds(read_in_part(hil)[0])
    assert "hip.torque_max_nm is 10" in error.allowed


@pytest.mark.parametrize("trainer", ["demo", "hil", "trainer", "two_legs", "vcan"])
def test_every_threshold_that_is_shipped_can_act(trainer):
    settings, _ = read_in_part(CONFIGS / f"{trainer}.toml")

    assert not [line for line in doubts(settings) if "can no longer act" in line]
