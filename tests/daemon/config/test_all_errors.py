"""All errors of a set of files are found in one run, and the file that is wrong is named."""

import re

import pytest
from command_line import gaitd
from config_files import CONFIGS, Change, changed, copied

from daemon.preflight.acceptance import check_files

ERRORS = (
    (Change("demo.toml", "announce_s = 3.0", "announce_s = 90.0"), "gait.announce_s"),
    (Change("demo.toml", 'channel = "/dev', 'chanel = "/dev'), "bus.chanel"),
    (Change("robot.toml", "recline_deg = 60.0", "recline_deg = 600.0"), "geometry.recline_deg"),
    (Change("limits.toml", "torque_max_nm = 62.0", 'torque_max_nm = "62"'), "hip.torque_max_nm"),
    (Change("limits.toml", "soft_ratio = 0.3", "soft_ratio = nan"), "singularity.soft_ratio"),
    (
        Change("drives/slide_epos4.toml", "rated_current_raw = 6000", "rated_current_raw = 60"),
        "motor.rated_current_raw",
    ),
    # Across files, of the tables that can be read.
    (
        Change("limits.toml", "setpoint_age_max_cycles = 10", "setpoint_age_max_cycles = 30"),
        "assist.setpoint_age_max_cycles",
    ),
    (
        Change("drives/hip_epos4.toml", "gear_ratio = 100.0", "gear_ratio = 0.02"),
        None,  # not compared: [hip] of limits.toml was refused
    ),
    (Change("demo.toml", "tcp/127.0.0.1:7447", "tcp/192.168.1.5:7447"), "zenoh.listen[0]"),
)


def test_all_errors_of_all_files_are_told_in_one_run(tmp_path):
    demo = changed(copied(tmp_path), *(change for change, _ in ERRORS))

    ended = gaitd("check", "--config", demo)

    lines = ended.err.splitlines()
    assert ended.code == 2
    assert sorted(line.split(": ")[2].split(" = ")[0] for line in lines) == sorted(
        key for _, key in ERRORS if key
    )
    verdict = f"{demo}: REFUSED, 8 errors; the sweeps of motion wait for their correction"
    assert ended.out.splitlines() == [verdict, verdict]


@pytest.mark.parametrize(
    ("changes", "file", "key", "words"),
    [
        (
            (Change("drives/hip_epos4.toml", "gear_ratio = 100.0", "gear_ratio = 1000.0"),),
            "drives/hip_epos4.toml",
            "transmission.gear_ratio",
            "at hip.velocity_max_rad_per_s = 4 the motor of right/hip would turn at 38197 rpm",
        ),
        (
            (Change("drives/slide_epos4.toml", "lead_m = 0.15 ", "lead_m = 1.5 "),),
            "drives/slide_epos4.toml",
            "transmission.gear_ratio",
            "with lead_m = 1.5: at 20 A right/slide gives 54.2 N, and slide.force_max_n is 480",
        ),
        # Less than three times too much is the limit's fault.
        (
            (Change("limits.toml", "torque_max_nm = 62.0", "torque_max_nm = 80.0"),),
            "limits.toml",
            "hip.torque_max_nm",
            "<= 66.9, what right/hip has at 12 A",
        ),
    ],
)
def test_a_gear_out_of_all_proportion_is_named_and_nothing_that_follows_from_it(
    tmp_path, changes, file, key, words
):
    demo = changed(copied(tmp_path), *changes)

    (error,) = check_files(demo).errors[:1]

    assert (error.file, error.key) == (str(demo.parent / file), key)
    assert words in error.allowed
    assert [error.file for error in check_files(demo).errors if "gear" in key] in (
        [],
        [str(demo.parent / file)],
    )


def test_quiet_prints_the_verdict_the_warnings_and_nothing_else():
    ended = gaitd("check", "--quiet", "--config", CONFIGS / "demo.toml")

    first, *warnings, last = ended.out.splitlines()
    assert (ended.code, ended.err) == (0, "")
    assert first == last == f"{CONFIGS}/demo.toml: good for one right leg, {len(warnings)} warnings"
    assert all(line.startswith("warning: ") for line in warnings)


FIRST_KEY = re.compile(r"^\[+[\w.]+\]+.*\n(?:\s*(?:#.*)?\n)*([\w.]+)(?= *= )", re.MULTILINE)
"""The first key of each table."""


@pytest.mark.parametrize("file", ["robot.toml", "limits.toml", "drives/profiles/epos4.toml"])
def test_a_typo_in_a_key_of_any_table_is_named_with_its_file(tmp_path, file):
    """What needs the table that was refused is left out: no check fails by it."""
    configs = copied(tmp_path)
    text = (CONFIGS / file).read_text(encoding="utf-8")
    for found in FIRST_KEY.finditer(text):
        typo = f"{text[: found.end()]}x{text[found.end() :]}"
        (configs / file).write_text(typo, encoding="utf-8")

        errors = check_files(configs / "demo.toml").errors

        named = {(error.file, error.key.rpartition(".")[2]) for error in errors}
        assert (str(configs / file), f"{found[1].rpartition('.')[2]}x") in named


def test_a_gait_in_which_the_hip_rests_is_checked_like_any_other(tmp_path):
    text = (CONFIGS / "demo.toml").read_text(encoding="utf-8")
    harmonics = re.search(r"hip.harmonics_deg = \[.*?\n\]", text, re.DOTALL)[0]
    resting = Change("demo.toml", harmonics, re.sub(r"-?\d+\.\d+", "0.0", harmonics))

    keys = {error.key for error in check_files(changed(copied(tmp_path), resting)).errors}

    assert "gait.cadence_max_hz" not in keys


@pytest.mark.parametrize("key", ["recline_deg = 60.0", "rail_angle_deg = 60.0"])
def test_a_mechanism_that_does_not_close_is_an_error_and_no_exception(tmp_path, key):
    name = key.partition(" ")[0]
    demo = changed(copied(tmp_path), Change("robot.toml", key, f"{name} = 0.0"))

    keys = {error.key for error in check_files(demo).errors}

    assert "slide.position_max_m" in keys
