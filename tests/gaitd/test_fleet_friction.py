"""`gaitd fleet friction`: wear of virtual trainers, found in the recordings of self-tests."""

import json
import math
import shutil
import time
from collections import defaultdict
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from gaitd_names import Mode, RequestKind
from gaitd_record import Purpose
from gaitd_toml import load_toml, read_toml
from processes import gaitd
from recorded_sessions import published_by, record
from scipy import stats
from sessions import CONFIGS, changed_configs

from analysis.fleet import FRICTION_SCHEMA, Job, Work, key_of, run_job
from analysis.friction_weeks import Advice, merge
from analysis.parquet import stays_in
from analysis.self_tests import friction_of
from daemon.config.edits import replaced
from daemon.config.settings import Robot
from daemon.ipc.record import ModeRequest
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.virtual_machine import virtual_machine

ROBOT = CONFIGS / "robot.toml"
GROWTH = 1.05
WEEKS = 4
WEEK = timedelta(weeks=1)
LEVELS = ("stribeck", "coulomb", "viscous")


def worn(robot, ratio):
    """The robot with another friction of the hip, at all speeds."""
    hip = robot.friction.hip
    levels = {name: getattr(hip, name) for name in hip.__struct_fields__ if name.startswith(LEVELS)}
    hip = msgspec.structs.replace(hip, **{name: ratio * one for name, one in levels.items()})
    friction = msgspec.structs.replace(robot.friction, hip=hip)
    return msgspec.structs.replace(robot, friction=friction)


def after_self_test(configs, ratio, week, seed):
    """From power-on to the end of a self-test."""
    settings = load(configs / "demo.toml")
    machine = virtual_machine(settings.file, robot=worn(settings.robot, ratio), seed=seed)
    session = LockstepSession(settings, machine)
    session.clock.utc_stepped_ns = week * round(WEEK.total_seconds() * 1e9)
    session.enable().execute(RequestKind.MODE, ModeRequest(Mode.SELF_TEST))
    session.until(Mode.HOLD, within_s=60)
    return session


@pytest.fixture(scope="module")
def soon(tmp_path_factory):
    """The folder of configurations, with motion that is announced for half a second."""
    announced = ("demo.toml", "announce_s = 3.0", "announce_s = 0.5")
    return changed_configs(tmp_path_factory.mktemp("soon"), announced)


@pytest.fixture(scope="module")
def sessions(soon):
    """Four weeks of one trainer."""
    return [after_self_test(soon, GROWTH**week, week, seed=10 + week) for week in range(WEEKS)]


@pytest.fixture(scope="module")
def recordings(sessions, tmp_path_factory):
    """`worn` has all of them, `other` the first one alone."""
    folder = tmp_path_factory.mktemp("recordings")
    for session in sessions:
        record(published_by(session, "worn"), folder / "worn", Purpose.TRAINING)
    record(published_by(sessions[0], "other"), folder / "other", Purpose.TRAINING)
    return folder


def friction(folders, output, *more):
    """Run it in a process of its own: Dask, once used, cannot go on in a fork of these tests."""
    words = ("fleet", "friction", *folders, "--robot", ROBOT, "--output", output, "--json")
    ended = gaitd(*map(str, (*words, "--workers", 1, *more)), timeout=240)
    return ended, json.loads(ended.stdout)


def test_wear_is_found_within_its_interval_and_bad_files_cost_themselves(
    sessions, recordings, tmp_path
):
    bad = tmp_path / "bad"
    first, *_ = sorted((recordings / "worn").iterdir())
    shutil.copytree(first, bad / "a copy")
    shutil.copytree(first, bad / "torn")
    torn = bad / "torn" / "right.recording.parquet"
    torn.write_bytes(torn.read_bytes()[:-100])
    first_session = sessions[0]
    before = SimpleNamespace(settings=first_session.settings, records=first_session.records[:100])
    without = record(published_by(before), bad).path
    (bad / "no modes.csv").touch()

    ended, told = friction(
        (recordings / "worn", recordings / "other", bad), tmp_path / "out", "--plot", tmp_path / "p"
    )

    assert ended.returncode == 1, ended.stderr
    assert f"{torn}: is no whole Parquet file" in ended.stderr
    assert f"{without}: right: has no self-test" in ended.stderr
    assert f"{bad / 'no modes.csv'}: has no modes" in ended.stderr
    failed = {Path(one["session"]).name for one in told["recordings"] if one["error"]}
    assert failed == {"torn", "no modes.csv"}
    hip, slide = (one for one in told["trends"] if one["trainer"] == "worn")
    assert hip["axis"] == "hip"
    assert hip["low_ratio_per_week"] < GROWTH - 1 < hip["high_ratio_per_week"]
    assert hip["high_ratio_per_week"] - hip["low_ratio_per_week"] < 0.02
    assert hip["change_ratio"] == pytest.approx(GROWTH ** (WEEKS - 1) - 1, abs=0.01)
    assert hip["advice"] == Advice.CALIBRATE
    assert slide["low_ratio_per_week"] < 0.0 < slide["high_ratio_per_week"]
    assert abs(slide["change_ratio"]) < 0.01
    assert slide["advice"] == Advice.NONE
    assert {one["advice"] for one in told["trends"] if one["trainer"] == "other"} == {
        Advice.TOO_FEW
    }
    hips = [one for one in told["weeks"] if one["trainer"] == "worn" and one["axis"] == "hip"]
    assert [one["week"] for one in hips] == ["2025-12-29", "2026-01-05", "2026-01-12", "2026-01-19"]
    assert {one["test_count"] for one in hips} == {1}  # the copy is the same test
    for number, one in enumerate(hips):
        assert one["median_ratio"] == pytest.approx(GROWTH**number, abs=0.01)
    assert (tmp_path / "p").read_bytes().startswith(b"\x89PNG")


def test_a_result_is_made_once_for_its_recording_code_and_robot(recordings, tmp_path):
    first, second, *_ = sorted((recordings / "worn").iterdir())
    robot, key = load_toml(ROBOT, Robot), key_of(Work.FRICTION, read_toml(ROBOT).sha256)

    def made(session, key):
        (result,) = run_job(Job(Work.FRICTION, session, robot, key, tmp_path), time.process_time)
        assert not result.error
        return result

    once, again = made(first, key), made(first, key)
    other = made(first, key_of(Work.FRICTION, "another"))

    assert (once.kept, again.kept, other.kept) == (False, True, False)
    assert once.rows == again.rows == 2
    assert len({once.file, again.file, other.file, made(second, key).file}) == 3


def test_a_wrong_mass_and_a_wrong_spring_are_not_taken_for_friction(recordings):
    first, *_ = sorted((recordings / "worn").iterdir())
    (test,) = stays_in(first, "right", "self_test").found
    robot = load_toml(ROBOT, Robot)
    wrong = replaced(
        robot,
        {
            "patient.mass_kg": 1.3 * robot.patient.mass_kg,
            "springs.hip.stiffness_nm_per_rad": 1.2 * robot.springs.hip.stiffness_nm_per_rad,
        },
    )

    for right, axis in zip(friction_of(test, robot), friction_of(test, wrong), strict=True):
        assert abs(axis.load_error_si) > 10 * abs(right.load_error_si)
        assert axis.friction_ratio == pytest.approx(right.friction_ratio, abs=0.02)


def test_the_file_s_offset_and_its_friction_along_the_axis_are_taken_off(recordings):
    first, *_ = sorted((recordings / "worn").iterdir())
    (test,) = stays_in(first, "right", "self_test").found
    robot = load_toml(ROBOT, Robot)
    at_m = float(np.median(test.recording.position[:, 1]))
    moved = {
        "effort_offset.hip.torque_nm": 1.0,
        "friction_over_position.slide.slope_per_m": 1.0,
        "friction_over_position.slide.middle_m": at_m - 0.2,
    }

    hip, slide = friction_of(test, robot)
    hip_there, slide_there = friction_of(test, replaced(robot, moved))

    assert hip_there.load_error_si == pytest.approx(hip.load_error_si - 1.0, abs=0.01)
    assert hip_there.friction_ratio == pytest.approx(hip.friction_ratio, abs=1e-3)
    assert slide_there.friction_ratio == pytest.approx(slide.friction_ratio / 1.2, rel=0.05)
    assert slide_there.friction_si == pytest.approx(slide.friction_si, rel=0.01)


def test_half_a_test_is_not_used(recordings):
    first, *_ = sorted((recordings / "worn").iterdir())
    (test,) = stays_in(first, "right", "self_test").found
    made = test.recording
    forth = slice(0, np.searchsorted(made.time_s, made.time_s[0] + 1.3))
    part = type(made)(made.source, made.time_s[forth], made.position[forth], made.effort[forth])

    hip, slide = friction_of(test._replace(recording=part), load_toml(ROBOT, Robot))

    assert "and 0 back at speed, fewer than 20" in hip.fault
    assert slide.fault.startswith("0 rows forth and 0 back")
    assert math.isnan(hip.friction_ratio)


@pytest.fixture
def warm_database():
    """DuckDB in a fork: at the end of its process it prints what it leaks."""


def test_duckdb_merges_as_numpy_and_scipy_do(tmp_path, warm_database):
    """Two trainers, with faults, over a year's end."""
    rng = np.random.default_rng(1)
    begin = datetime(2025, 12, 10, 8, 30)
    rows, by_week, by_axis = [], defaultdict(list), defaultdict(list)
    for number in range(60):
        begun = begin + timedelta(hours=float(rng.uniform(0, 24 * 40)))
        trainer, fault = f"home{number % 2}", "none" if number % 7 == 0 else ""
        for axis in ("hip", "slide"):
            ratio = float(rng.lognormal(0.02 * (begun - begin) / WEEK, 0.03))
            named = {"trainer": trainer, "recording": f"{number}", "leg": "right", "axis": axis}
            told = {
                "begun_utc": begun,
                "friction_ratio": ratio,
                "friction_si": 6 * ratio,
                "fault": fault,
            }
            rows.append({**named, **told})
            if not fault:
                monday = (begun - timedelta(days=begun.weekday())).date()
                by_week[trainer, "right", axis, monday].append(ratio)
                by_axis[trainer, "right", axis].append((begun, ratio))
    half = len(rows) // 2
    files = [tmp_path / "1.parquet", tmp_path / "2.parquet"]
    for file, part in zip(files, (rows[: half + 4], rows[half:]), strict=True):  # some twice
        pq.write_table(pa.Table.from_pylist(part, FRICTION_SCHEMA), file)

    merged = merge(files, tmp_path, 0.1)

    assert [one[:4] for one in merged.weeks] == sorted(by_week)
    assert any(len(ratios) == 1 for ratios in by_week.values())
    for week, (_, ratios) in zip(merged.weeks, sorted(by_week.items()), strict=True):
        assert week.test_count == len(ratios)
        assert week.median_ratio == pytest.approx(np.median(ratios))
        assert (week.lowest_ratio, week.highest_ratio) == (min(ratios), max(ratios))
        assert week.friction_si == pytest.approx(6 * np.median(ratios))
        if len(ratios) == 1:
            assert week.half_width_ratio is None
        else:
            low, high = stats.t.interval(
                0.95, len(ratios) - 1, loc=np.mean(ratios), scale=stats.sem(ratios)
            )
            assert week.mean_ratio == pytest.approx((low + high) / 2)
            assert week.half_width_ratio == pytest.approx((high - low) / 2)
    for trend, (named, tests) in zip(merged.trends, sorted(by_axis.items()), strict=True):
        first = min(tests)[0]
        at_week = [(begun - first) / WEEK for begun, _ in tests]
        line = stats.linregress(at_week, [math.log(ratio) for _, ratio in tests])
        around = stats.t.ppf(0.975, len(tests) - 2) * line.stderr
        assert trend[:4] == (*named, len(tests))
        assert trend.span_weeks == pytest.approx(max(at_week))
        assert trend.growth_ratio_per_week == pytest.approx(math.expm1(line.slope))
        assert trend.low_ratio_per_week == pytest.approx(math.expm1(line.slope - around))
        assert trend.high_ratio_per_week == pytest.approx(math.expm1(line.slope + around))
        assert trend.change_ratio == pytest.approx(math.expm1(line.slope * max(at_week)))
    assert len(merged.unused) == 2 * 9
    written = pq.read_table(tmp_path / "friction_weeks.parquet")
    assert written.num_rows == len(by_week)
    assert len((tmp_path / "friction_weeks.csv").read_text().splitlines()) == 1 + len(by_week)


@pytest.mark.thorough
def test_a_trainer_that_does_not_wear_has_no_trend(soon, tmp_path, warm_database):
    for week in range(WEEKS):
        session = after_self_test(soon, 1.0, week, seed=100 + week)
        record(published_by(session, "steady"), tmp_path / "recordings", Purpose.TRAINING)

    ended, told = friction([tmp_path / "recordings"], tmp_path / "out")

    assert ended.returncode == 0
    assert {one["advice"] for one in told["trends"]} == {Advice.NONE}
    assert all(abs(one["change_ratio"]) < 0.01 for one in told["trends"])
