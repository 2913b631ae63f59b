import tomllib

import numpy as np
import pytest
from command_line import gaitd
from gaitd_toml import ConfigError, load_toml
from sessions import CONFIGS, changed_configs

from daemon.config.robot import considered
from daemon.config.settings import Robot
from daemon.ipc.transport import RING_NAME, RingHeader, RingWriter
from daemon.preflight.load import load
from tests.observer.trainer import PATIENT, encoded, gait, simulate


def write(path, columns):
    header = "time_s,hip_angle_rad,slide_position_m,hip_torque_nm,slide_force_n"
    rows = np.column_stack((columns.time_s, columns.position, columns.effort))
    np.savetxt(path, rows, "%.9g", ",", header=header, comments="")
    return path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A passive walk of a leg that weighs more than the robot file says."""
    heavy = PATIENT._replace(hip_rest_rad=PATIENT.hip_rest_rad + 0.1)
    cycles = 2100
    path = gait(heavy, np.maximum(np.arange(1, cycles + 1) * 0.01 - 1.0, 0.0), 0.5)
    truth = simulate(heavy, cycles, reference=path, start=path[0])
    return write(tmp_path_factory.mktemp("passive") / "passive.csv", encoded(truth))


@pytest.fixture(scope="module")
def baseline(recorded):
    out = recorded.with_name("baseline.toml")
    ran = gaitd("baseline", recorded, "--robot", CONFIGS / "robot.toml", "--output", out)
    assert ran.code == 0, ran.err
    assert "strides" in ran.out
    return out


def test_a_passive_run_becomes_a_file_with_what_it_says_of_the_robot(baseline):
    written = tomllib.loads(baseline.read_text())

    assert written["cadence_hz"] == pytest.approx(0.5, rel=0.02)
    count = len(written["theta"])
    assert [len(row) for row in written["covariance"]] == [count] * count
    # A spring of another rest is one error of the file among those that look like it.
    assert max(abs(theta) for theta in written["theta"]) > 0.5


def test_strides_without_the_baseline_show_next_to_nothing(recorded, baseline, tmp_path):
    bare, clean = tmp_path / "bare.csv", tmp_path / "clean.csv"
    robot = ("--robot", CONFIGS / "robot.toml", "--output", tmp_path / "e.csv")
    assert gaitd("replay", recorded, *robot, "--strides", bare).code == 0
    ran = gaitd("replay", recorded, *robot, "--strides", clean, "--baseline", baseline)
    assert ran.code == 0, ran.err

    def work(path):
        table = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
        assert set(table["baseline_subtracted"]) == {int(path == clean)}
        return np.mean(table["hip_work_positive_j"][1:])

    assert work(bare) > 1.0
    assert work(clean) < 0.15 * work(bare)


def test_smooth_writes_the_same_columns(recorded, tmp_path):
    out = tmp_path / "smooth.csv"
    robot = ("--robot", CONFIGS / "robot.toml")

    ran = gaitd("replay", recorded, *robot, "--smooth", "--output", out)

    assert ran.code == 0, ran.err
    assert "smoothed" in ran.out
    from analysis.estimates import COLUMNS

    assert out.read_text().splitlines()[0] == ",".join(COLUMNS)


def test_a_recording_with_too_few_strides_is_refused(recorded, tmp_path):
    short = tmp_path / "short.csv"
    short.write_text("\n".join(recorded.read_text().splitlines()[:500]) + "\n")
    out = tmp_path / "b.toml"

    ran = gaitd("baseline", short, "--robot", CONFIGS / "robot.toml", "--output", out)

    assert ran.code == 2
    assert "strides; a baseline needs at least 8" in ran.err
    assert not out.exists()


def test_a_push_that_no_plausible_error_of_the_file_explains_is_refused(recorded, tmp_path):
    columns = np.loadtxt(recorded, delimiter=",", skiprows=1)
    columns[:, 4] -= 60.0
    header = recorded.read_text().splitlines()[0]
    pushed, out = tmp_path / "pushed.csv", tmp_path / "b.toml"
    np.savetxt(pushed, columns, "%.9g", ",", header=header, comments="")

    ran = gaitd("baseline", pushed, "--robot", CONFIGS / "robot.toml", "--output", out)

    assert ran.code == 2
    assert "the slide asks for an error of " in ran.err
    assert "at most 4 are plausible: let the patient relax and record again" in ran.err
    assert not out.exists()


@pytest.mark.parametrize(
    "command",
    [
        ("baseline", "--robot", CONFIGS / "robot.toml", "--output", "baseline.toml"),
        ("calibrate", "--robot", CONFIGS / "robot_empty.toml", "--output", "robot.toml"),
        ("calibrate", "--robot", CONFIGS / "robot_empty.toml", "--check"),
        ("delay",),
    ],
    ids=["baseline", "calibrate", "check", "delay"],
)
def test_a_recording_of_two_legs_is_asked_of_which(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    ring = tmp_path / RING_NAME
    header = RingHeader(
        core_boot_id="test",
        start_utc_ns=0,
        period_ns=10_000_000,
        trainer="trainer",
        drive_names=("right/hip", "right/slide", "left/hip", "left/slide"),
        leg_names=("right", "left"),
        config_hashes={},
        version="test",
        robot={},
        limits={},
    )
    RingWriter(ring, header).close()
    name, *options = command

    ran = gaitd(name, ring, *options)
    one = gaitd(name, ring, *options, "--leg", "left")

    assert (ran.code, one.code) == (2, 2)
    assert f"{ring}: has right and left: choose one with --leg" in ran.err
    assert "the observer ran in none of its 0 records" in one.err
    assert list(tmp_path.iterdir()) == [ring]


def test_the_service_takes_the_baseline_that_a_leg_names(baseline, tmp_path):
    configs = changed_configs(
        tmp_path,
        ("demo.toml", 'name = "right"', f'name = "right"\nbaseline = "{baseline}"'),
    )

    named = load(configs / "demo.toml").legs[0].baseline
    assert named.stride_count > 7
    assert named.theta.shape == (len(considered(load_toml(CONFIGS / "robot.toml", Robot))),)


def test_a_baseline_of_another_robot_is_refused_with_its_hash(baseline, tmp_path):
    configs = changed_configs(
        tmp_path,
        ("demo.toml", 'name = "right"', f'name = "right"\nbaseline = "{baseline}"'),
        ("robot.toml", "coulomb_nm = 6.0", "coulomb_nm = 6.1"),
    )

    with pytest.raises(ConfigError, match="robot_sha256") as refused:
        load(configs / "demo.toml")
    assert "record it again" in refused.value.lines
