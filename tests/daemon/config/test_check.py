"""`gaitd check`: what it computes, what it refuses, and how it ends."""

import json

import pytest
from command_line import gaitd
from config_files import CONFIGS, Change, changed, copied

from daemon.preflight.load import load
from daemon.preflight.report import examine, refusals
from gaitd.terminal import plain, print_tables

EMPTY_WITH_A_PATIENTS_SPRINGS = (
    Change("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
    Change("robot_empty.toml", "hip.rest_rad = 1.0601", "hip.rest_rad = 2.3132"),
    Change("robot_empty.toml", "slide.rest_m = 1.1442", "slide.rest_m = 1.3247"),
)


@pytest.fixture(scope="module")
def report():
    return examine(load(CONFIGS / "demo.toml"))


def test_one_count_one_permille_and_one_milliampere_are_told_at_each_joint(report):
    hip, slide = report.axes

    assert hip.position_per_count == pytest.approx(2 * 3.141592653589793 / (1024 * 100))
    assert hip.effort_per_permille == pytest.approx(0.055736 * 5.0 * 100 / 1000)
    assert hip.effort_per_ma == pytest.approx(0.055736 * 100 / 1000)
    assert slide.position_per_count == pytest.approx(-0.15 / (512 * 6))
    assert slide.effort_per_ma == pytest.approx(-0.107746 * 6 * 2 * 3.141592653589793 / 0.15 / 1000)
    assert slide.effort_per_permille == pytest.approx(6.0 * slide.effort_per_ma)


def test_limits_are_told_against_what_the_drives_have(report):
    hip, slide = report.axes

    assert hip.effort_limit_si < hip.effort_drive_limit_si == pytest.approx(66.9, abs=0.05)
    assert slide.effort_limit_si < slide.effort_drive_limit_si == pytest.approx(541.6, abs=0.05)
    assert hip.torque_limit_raw == int(62.0 / 100 / 0.055736 * 1000)


def test_every_cause_has_its_category_and_who_chose_it(report):
    stops = {stop.cause: (stop.category, stop.fixed) for stop in report.stops}

    assert stops["encoder_jump"] == ("S0", True)
    assert stops["drive_silent"] == ("S1", True)
    assert stops["stop_requested"] == ("S2", False)
    assert [stop.category for stop in report.stops] == sorted(
        stop.category for stop in report.stops
    )


def test_all_three_kinds_of_stop_stay_inside_the_workspace(report):
    assert len(report.sweeps) == 3
    assert all(sweep.stays_inside for sweep in report.sweeps)
    assert min(sweep.least_singularity_ratio for sweep in report.sweeps) > 0.6


def test_a_leg_without_its_drives_has_the_least_friction_along_its_axes(report, tmp_path):
    rising = (
        Change("robot.toml", "hip.slope_per_rad = 0.0", "hip.slope_per_rad = 0.5"),
        Change("robot.toml", "slide.slope_per_m = 0.0", "slide.slope_per_m = 0.4"),
    )

    found = examine(load(changed(copied(tmp_path), *rising)))

    assert found.drift.hip_moved_deg > 1.05 * report.drift.hip_moved_deg
    hip_coasts = found.sweeps[1]
    assert hip_coasts.least_singularity_ratio < report.sweeps[1].least_singularity_ratio - 0.005
    for before, after in zip(report.runaways, found.runaways, strict=True):
        assert after.distance_si > before.distance_si


def test_the_empty_machine_passes_with_its_springs_turned_down(tmp_path):
    settings = load(changed(copied(tmp_path), EMPTY_WITH_A_PATIENTS_SPRINGS[0]))

    found = examine(settings)

    assert not list(refusals(settings, found))
    assert not found.drift.reaches_limit
    assert "no patient is configured: for the empty machine alone" in found.warnings


def test_the_empty_machine_is_refused_with_a_patients_springs(tmp_path):
    settings = load(changed(copied(tmp_path), *EMPTY_WITH_A_PATIENTS_SPRINGS))
    found = examine(settings)

    refused = next(refusals(settings, found))

    assert refused.file == str(tmp_path / "configs/demo.toml")
    assert refused.key == "gait.cadence_max_hz"
    assert refused.value == "0.5"
    assert "with hip coasting, slide on its ramp the leg goes to hip" in refused.allowed
    assert "without power the leg moves to a position limit: check the springs" in found.warnings


def test_a_listener_that_others_can_reach_is_a_warning(tmp_path):
    demo = changed(copied(tmp_path), Change("demo.toml", "tcp/127.0.0.1:7447", "tcp/0.0.0.0:7447"))

    found = examine(load(demo))

    assert "zenoh.listen: tcp/0.0.0.0:7447 can be reached from other machines" in found.warnings


def test_a_missing_plant_is_a_warning_because_the_service_needs_none(tmp_path):
    configs = copied(tmp_path)
    (configs / "plant.toml").unlink()

    found = examine(load(configs / "demo.toml"))

    assert any("plant.toml does not exist" in warning for warning in found.warnings)


def test_sigterm_is_told_with_what_the_leg_then_does(report):
    told = "\n".join(report.shutdown)

    assert "at rest after at most 0.27 s (S1)" in told
    assert "no axis has a brake" in told
    assert f"moves up to {report.drift.hip_moved_deg:.1f} deg" in told


def test_the_command_ends_with_0_and_tells_all_of_it_on_a_good_configuration():
    ended = gaitd("check", "--config", CONFIGS / "demo.toml")

    assert (ended.code, ended.err) == (0, "")
    for part in ("one count", "Workspace", "Without power", "Bus", "SIGTERM", "SHA-256"):
        assert part in ended.out
    assert "\x1b" not in ended.out
    assert not set("│┃─━") & set(ended.out)


def test_the_command_tells_a_program_the_same_in_json():
    ended = gaitd("check", "--json", "--config", CONFIGS / "demo.toml")

    told = json.loads(ended.out)
    assert ended.code == 0
    assert {"axes", "stops", "sweeps", "drift", "bus", "shutdown", "warnings", "sha256"} < set(told)
    assert told["bus"]["load_ratio"] < told["bus"]["load_max_ratio"]


def test_the_command_ends_with_2_and_one_line_for_an_error_of_one_value(tmp_path):
    demo = changed(
        copied(tmp_path), Change("limits.toml", "torque_max_nm = 62.0", "torque_max_nm = 300.0")
    )

    ended = gaitd("check", "--config", demo)

    refused = f"{demo}: REFUSED, 1 error; the sweeps of motion wait for their correction\n"
    assert (ended.code, ended.out) == (2, 2 * refused)
    assert ended.err == (
        f"configuration error: {demo.parent / 'limits.toml'}: hip.torque_max_nm = 300.0: "
        "a number >= 0.5 and <= 120\n"
    )


def test_the_command_shows_the_sweep_that_it_refuses(tmp_path):
    demo = changed(copied(tmp_path), *EMPTY_WITH_A_PATIENTS_SPRINGS)

    ended = gaitd("check", "--config", demo)

    assert ended.code == 2
    assert "LEAVES THE WORKSPACE" in ended.out
    first, *_, last = ended.out.splitlines()
    assert first == last
    assert first.startswith(f"{demo}: REFUSED, 2 errors, ")
    assert ended.err.startswith("configuration error: ")
    assert ended.err.count("\n") == 2


def test_a_terminal_gets_tables(capsys):
    section = ("Bus", ("", "what"), (("load", "10 [%]"),))

    print_tables((section,))

    assert "10 [%]" in capsys.readouterr().out
    assert plain(section) == "Bus\n        what\n  load  10 [%]"
