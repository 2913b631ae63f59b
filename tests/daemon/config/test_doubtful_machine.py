"""What `gaitd check` refuses of a machine, and what it warns of: the shipped files with one edit.

Each row of REFUSED and WARNED is an edit and what is then said of it, by file, key and value.
"""

from typing import NamedTuple

import pytest
from config_files import CONFIGS, Change, changed, copied

from daemon.config.trainer import read_trainer
from daemon.preflight.acceptance import check_files
from daemon.preflight.doubts import doubts
from daemon.preflight.files import check_all
from daemon.preflight.load import load, read_in_part
from daemon.preflight.stability import loop_errors, loop_meanings, loop_warnings


class Row(NamedTuple):
    change: Change
    file: str
    key: str
    value: str
    words: str


def row(file: str, old: str, new: str, key: str, value: str, words: str, *, of: str = "") -> Row:
    """A row of a change in one file that is told of this file, or `of` another."""
    return Row(Change(file, old, new), of or file, key, value, words)


EPOS4 = "drives/profiles/epos4.toml"
HIP = "drives/hip_epos4.toml"
SIGNS = '"proven": a motor connected the wrong way round runs away from the first hold'
LOST_TURNS = "an encoder that has lost turns is believed"
REFUSED = [
    row(
        *("trainer.toml", 'signs = "proven"', 'signs = "assumed"'),
        *("commissioning.signs", '"assumed"', SIGNS),
    ),
    row(
        *("trainer.toml", "hip.pose_tolerance_deg = 1.5", "hip.pose_tolerance_deg = 180.0"),
        *("reference.hip.pose_tolerance_deg", "180.0", f"< 60, the axis's range; {LOST_TURNS}"),
    ),
    row(
        *("trainer.toml", "slide.pose_tolerance_m = 0.01", "slide.pose_tolerance_m = 0.95"),
        *("reference.slide.pose_tolerance_m", "0.95", f"< 0.95, the axis's range; {LOST_TURNS}"),
    ),
    *(
        row(
            *("limits.toml", f'{cause} = "S1"', f'{cause} = "S2"'),
            *(f"stop_category.{cause}", '"S2"', f"S1 or S0: {why}"),
        )
        for cause, why in (
            ("position_limit", "the joint is where the core's own command should never"),
            ("velocity_limit", "the core's own command did not keep the speed"),
            ("effort_limit", "the drive gives more than the core commands"),
            ("singularity", "near the stretched leg a small force"),
        )
    ),
    row(
        *(EPOS4, "[torque_source]\nindex = 0x30D1\nsub = 2\nbits = 32"),
        "[torque_source]\nindex = 0x6071\nsub = 0\nbits = 16",
        *("torque_source", '"6071h:00"', "it shows what was commanded"),
    ),
    row(
        *(EPOS4, "[torque_limit]\nindex = 0x3001\nsub = 2\nbits = 32"),
        "[torque_limit]\nindex = 0x6071\nsub = 0\nbits = 16",
        *("torque_limit", '"6071h:00"', "a command limits nothing"),
    ),
    row(
        *(HIP, "current_limit_a = 12.0", "current_limit_a = 12.0\npeak_current_a = 11.0"),
        *("motor.current_limit_a", "12.0", "at most peak_current_a = 11"),
    ),
    row(
        *(HIP, "method = 17 ", "stop_current_a = 12.5\nmethod = -4 "),
        *("homing.stop_current_a", "12.5", "the motor never gets it"),
    ),
]

WARNED = [
    *(
        row(
            *(EPOS4, f"factor = 1.0{after}", f"factor = {factor}{after}"),
            *(f"{name}.factor", factor, f"{place} of right/hip would be {counts}"),
        )
        for name, after, factor, place, counts in (
            ("torque_source", "\nsign = 1", "1000.0", "30D1h:02", "12,"),
            ("torque_source", "\nsign = 1", "0.001", "30D1h:02", "1.2e+07,"),
            ("torque_limit", "\n\n[target_torque]", "1000.0", "3001h:02", "12,"),
            ("target_torque", "\n\n[temperature]", "0.001", "6071h:00", "2.4e+06,"),
        )
    ),
    row(
        *(EPOS4, 'velocity_unit = "rpm" ', 'velocity_unit = "counts_per_s" '),
        *("velocity_unit", '"counts_per_s"', "6080h of right/hip would be 17.1 times too wide"),
    ),
    row(
        *("limits.toml", "hip.standstill_rad_per_s = 0.05", "hip.standstill_rad_per_s = 0.41"),
        *("stop.hip.standstill_rad_per_s", "0.41", "above a tenth of the highest speed, 4:"),
    ),
    row(
        *("limits.toml", "slide.standstill_m_per_s = 0.03", "slide.standstill_m_per_s = 0.36"),
        *("stop.slide.standstill_m_per_s", "0.36", "above a tenth of the highest speed, 3.5:"),
    ),
    row(
        *("trainer.toml", "hip.damping_nm_s_per_rad = 3.0", "hip.damping_nm_s_per_rad = 0.0"),
        *("hand_guiding.hip.damping_nm_s_per_rad", "0.0", "nothing but friction slows"),
    ),
    row(
        *("limits.toml", "slide.damping_n_s_per_m = 600.0", "slide.damping_n_s_per_m = 0.0"),
        *("soft_limit.slide.damping_n_s_per_m", "0.0", "nothing but friction slows"),
    ),
    row(
        *("limits.toml", "force_max_n = 480.0", "force_max_n = 60.0"),
        *("transmission.gear_ratio", "6.0", "9.03 times the limit of its joint"),
        of="drives/slide_epos4.toml",
    ),
    row(
        *(HIP, "current_limit_a = 12.0", "current_limit_a = 20.5"),
        *("motor.current_limit_a", "20.5", "more than 4 times nominal_current_a = 5; give motor."),
    ),
    row(
        *("trainer.toml", 'required = "daily"', 'required = "never"'),
        *("self_test.required", '"never"', "where a person uses the machine"),
    ),
    row(
        *("robot.toml", "[patient]", '[calibration]\nmissed_limits = ["mechanism"]\n\n[patient]'),
        *("calibration.missed_limits", "['mechanism']", "before a self-test has passed; calibrate"),
    ),
]

LOOPS = [
    row(
        *("trainer.toml", "hip.damping_nm_s_per_rad = 20.0", "hip.damping_nm_s_per_rad = 0.0"),
        *("hold.hip.damping_nm_s_per_rad", "0.0", ">= "),
    ),
    row(
        *("trainer.toml", "slide.stiffness_n_per_m = 4000.0", "slide.stiffness_n_per_m = 20000.0"),
        *("hold.slide.stiffness_n_per_m", "20000.0", "<= 1"),
    ),
    row(
        *("trainer.toml", "damping_beyond_n_s_per_m = 350.0", "damping_beyond_n_s_per_m = 1500.0"),
        *("hand_guiding.slide.damping_beyond_n_s_per_m", "1500.0", "<= "),
    ),
    row(
        *("limits.toml", "slide.damping_n_s_per_m = 600.0", "slide.damping_n_s_per_m = 1800.0"),
        *("soft_limit.slide.damping_n_s_per_m", "1800.0", "<= "),
    ),
]

SOFT = [
    row(
        *("trainer.toml", "slide.edge_n = 250.0", "slide.edge_n = 500.0"),
        *("hand_guiding.slide.edge_n", "500.0", "or a wider soft margin"),
    ),
    row(
        *("robot.toml", "hip.slope_per_rad = 0.0", "hip.slope_per_rad = 0.6"),
        *("hand_guiding.hip.edge_nm", "40.0", "the margin against shaking is 0.90"),
        of="trainer.toml",
    ),
]


def trainer_with(tmp_path, change):
    """trainer.toml, whose bus has real drives, with one edit in it or in a file that it names."""
    return changed(copied(tmp_path), change).with_name("trainer.toml")


def ids(rows):
    return [f"{one.key} = {one.value}" for one in rows]


@pytest.mark.parametrize("row", REFUSED, ids=ids(REFUSED))
def test_what_endangers_a_real_machine_is_refused(tmp_path, row):
    settings, errors = read_in_part(trainer_with(tmp_path, row.change))

    (error,) = errors + check_all(settings).errors

    assert (error.file, error.key, error.value) == (
        str(tmp_path / "configs" / row.file),
        row.key,
        row.value,
    )
    for part in row.words.split("; "):
        assert part in error.allowed


@pytest.mark.parametrize("row", WARNED, ids=ids(WARNED))
def test_what_is_more_often_a_mistake_is_a_warning(tmp_path, row):
    settings, _ = read_in_part(trainer_with(tmp_path, row.change))

    said = f"{tmp_path / 'configs' / row.file}: {row.key} = {row.value}: "
    warning = next(line for line in doubts(settings) if line.startswith(said))

    assert row.words in warning


@pytest.mark.parametrize("row", LOOPS, ids=ids(LOOPS))
def test_gains_with_which_a_loop_shakes_are_refused_with_those_that_do_not(tmp_path, row):
    meanings = loop_meanings(load(trainer_with(tmp_path, row.change)))

    (error,) = loop_errors(meanings)

    assert (error.file, error.key, error.value) == (
        str(tmp_path / "configs" / row.file),
        row.key,
        row.value,
    )
    assert error.allowed.startswith(row.words)
    assert "below 1 it shakes" in error.allowed


@pytest.mark.parametrize("row", SOFT, ids=ids(SOFT))
def test_an_end_spring_that_friction_does_not_hold_is_a_warning(tmp_path, row):
    meanings = loop_meanings(load(trainer_with(tmp_path, row.change)))

    warnings = list(loop_warnings(meanings))

    assert not list(loop_errors(meanings))
    said = f"{tmp_path / 'configs' / row.file}: {row.key} = {row.value}: "
    assert any(line.startswith(said) and row.words in line for line in warnings)


def test_the_values_that_a_refusal_allows_do_not_shake(tmp_path):
    much = Change(
        "trainer.toml", "slide.damping_n_s_per_m = 250.0", "slide.damping_n_s_per_m = 2000.0"
    )
    (error,) = loop_errors(loop_meanings(load(trainer_with(tmp_path / "much", much))))
    least, most = (float(part.split()[-1]) for part in error.allowed.split(":")[0].split(" and "))

    for name, value, stable in (
        ("least", least, True),
        ("most", most, True),
        ("no", most * 1.2, False),
    ):
        change = much._replace(new=f"slide.damping_n_s_per_m = {value}")
        meanings = loop_meanings(load(trainer_with(tmp_path / name, change)))
        assert (not list(loop_errors(meanings))) == stable


@pytest.mark.parametrize("trainer", ["demo", "trainer"])
def test_every_shipped_loop_is_stable_and_one_soft_limit_has_a_small_margin(trainer):
    meanings = loop_meanings(load(CONFIGS / f"{trainer}.toml"))

    assert min(loop.margin_ratio for loop in meanings) > 1.1
    assert [loop.loop for loop in meanings if loop.margin_ratio < 1.25] == [
        "soft limit in hand_guiding"
    ]


def test_virtual_drives_on_a_real_bus_may_be_declared(tmp_path):
    on_can0 = Change("vcan.toml", '"vcan0"', '"can0"')
    bench = Change("vcan.toml", '"vcan0"', '"can0"\nvirtual_drives = true')

    undeclared = changed(copied(tmp_path / "real"), on_can0).with_name("vcan.toml")
    declared = changed(copied(tmp_path / "bench"), bench).with_name("vcan.toml")

    assert [error.key for error in check_all(load_anyway(undeclared)).errors] == [
        "commissioning.signs",
        "reference.hip.pose_tolerance_deg",
        "reference.slide.pose_tolerance_m",
    ]
    assert not check_all(load_anyway(declared)).errors


@pytest.mark.parametrize(
    ("file", "names", "words"),
    [
        ("hil.toml", "[]", "some of right/hip, right/slide; true for all, absent for none"),
        ("hil.toml", '["right/hip", "right/slide"]', "some of right/hip, right/slide; true for"),
        ("hil.toml", '["left/slide"]', "each once; not left/slide"),
        ("hil.toml", '["right/hip", "right/hip"]', "each once; not right/hip"),
        ("hil.toml", '["slide"]', "some of right/hip, right/slide, each once; not slide"),
        ("demo.toml", '["right/slide"]', "absent on a simulated bus"),
    ],
)
def test_a_list_of_virtual_drives_that_makes_no_sense_is_refused(tmp_path, file, names, words):
    configs = copied(tmp_path)
    old = "load_max_ratio" if file == "demo.toml" else 'virtual_drives = ["right/slide"]'
    added = "\nload_max_ratio" if file == "demo.toml" else ""
    changed(configs, Change(file, old, f"virtual_drives = {names}{added}"))

    _, (error,) = read_trainer(configs / file)

    assert error.key == "bus.virtual_drives"
    assert words in error.allowed


def test_a_vcan_with_a_list_of_virtual_drives_has_real_ones(tmp_path):
    mixed = Change("vcan.toml", '"vcan0"', '"vcan0"\nvirtual_drives = ["right/slide"]')
    file = changed(copied(tmp_path), mixed).with_name("vcan.toml")

    assert next(iter(check_all(load_anyway(file)).errors)).key == "commissioning.signs"
    bus = check_files(CONFIGS / "hil.toml").report.bus
    assert (bus.real_drives, bus.virtual_drives) == (("right/hip",), ("right/slide",))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (Change("hil.toml", "[[leg]]", "[[leg]]"), []),
        (
            Change("hil.toml", 'virtual_drives = ["right/slide"]', ""),
            ["reference.slide.pose_tolerance_m = 0.9: less than 0.025, a turn of the motor"],
        ),
        (
            Change("hil.toml", '["right/slide"]', "true"),
            ["bus.virtual_drives = true: no drive on can0 counts as real"],
        ),
    ],
    ids=["as shipped", "with a real slide", "all declared virtual"],
)
def test_a_bench_s_file_that_is_used_for_a_machine_is_warned_of(tmp_path, change, words):
    path = changed(copied(tmp_path), change).with_name("hil.toml")

    found = [one for one in doubts(load_anyway(path)) if "virtual" in one or "turn of" in one]

    assert len(found) == len(words)
    assert all(word in line for word, line in zip(words, found, strict=True))


def load_anyway(path):
    return read_in_part(path)[0]


def test_scenarios_that_push_without_guidance_are_doubted_where_the_file_names_a_patient():
    report = check_files(CONFIGS / "trainer.toml").report

    assert report is not None
    assert [line for line in report.warnings if ": excite = " in line]
