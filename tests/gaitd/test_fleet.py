"""`gaitd fleet estimate`: the results of a replay, from a cluster and after losses as well."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import distributed
import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import gaitd
from duckdb_program import rows_of
from power_cuts import check
from sessions import CONFIGS
from traced_calls import mark

from analysis import fleet as results
from analysis.estimates import COLUMNS
from analysis.recording import COLUMNS as INPUTS
from analysis.replay import estimate, read
from daemon.preflight.robot import load_robot
from observer.filter.status import Validity
from tests.observer.trainer import PATIENT, encoded, gait, simulate

ROBOT = CONFIGS / "robot.toml"
CSV_COUNT = 4
PUBLIC = Path(__file__).parent / "public_cases/five_columns.parquet"
FLEET_PAGE = CONFIGS.parent / "docs" / "fleet.md"


@pytest.fixture(scope="module")
def five_columns(tmp_path_factory):
    """The five columns of a recording, taken out of it by pyarrow with its metadata."""
    about = {
        "id": "6a3e",
        "trainer": "t",
        "core_boot_id": "6450",
        "gaitd_version": "0",
        "robot": {},
    }
    truth = simulate(PATIENT, 200, reference=gait(PATIENT, np.arange(1, 201) * 0.01, 0.3))
    columns = encoded(truth)
    values = np.column_stack((columns.time_s, columns.position, columns.effort))
    about["robot"] = msgspec.to_builtins(load_robot(ROBOT))
    whole = pa.table({name: values[:, at] for at, name in enumerate(INPUTS)})
    metadata = {"gaitd": json.dumps(about), "gaitd.leg": "right"}
    file = tmp_path_factory.mktemp("five") / "five.parquet"
    pq.write_table(whole.replace_schema_metadata(metadata), file)
    return file


@pytest.fixture(scope="module")
def sessions(tmp_path_factory):
    """Two trainers, two recordings of each, with the same names."""
    folder = tmp_path_factory.mktemp("sessions")
    for number in range(CSV_COUNT):
        time_s = np.arange(1, 201) * 0.01
        truth = simulate(PATIENT, 200, reference=gait(PATIENT, time_s, 0.2 + 0.05 * number))
        columns = encoded(truth)
        table = np.column_stack((columns.time_s, columns.position, columns.effort))
        file = folder / f"trainer{number // 2}" / f"day{number % 2}.csv"
        file.parent.mkdir(exist_ok=True)
        lines = (",".join(map(repr, row)) for row in table.tolist())
        file.write_text("\n".join((",".join(INPUTS), *lines)) + "\n")
    return folder


@pytest.fixture(scope="module")
def threads():
    """Workers of this computer are threads of this process, which start at once.

    Its processes are those of test_fleet_friction.py, and those of a cluster are below.
    """
    made = partial(distributed.LocalCluster, processes=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("distributed.LocalCluster", made)
        yield


def fleet(sessions, output, *more, robot=ROBOT):
    """The two trainers' folders; the results by file of the recording."""
    folders = sorted(sessions.iterdir())
    ended = gaitd(
        *("fleet", "estimate", *folders, "--robot", robot, "--output", output, "--json"), *more
    )
    return ended, {one["session"]: one for one in json.loads(ended.out)}


@pytest.fixture(scope="module")
def made(sessions, threads, tmp_path_factory):
    """What two workers made: folder, and what the command said."""
    output = tmp_path_factory.mktemp("made") / "results"
    ended, results = fleet(sessions, output, "--workers", 2)
    assert ended.code == 0, ended.err
    return output, results


def test_results_are_a_replay_s_bits(made):
    _, first = made

    assert len(first) == CSV_COUNT
    for session, result in first.items():
        source = read(Path(session))
        expected = estimate(source, load_robot(ROBOT))
        table = pq.read_table(result["file"])
        assert table.column_names == list(COLUMNS)
        np.testing.assert_array_equal(table["time_s"], source.recording.time_s)
        is_split = expected.validity[:, 0] == Validity.OK
        patient = np.where(is_split, expected.state[:, 6], np.nan)
        assert table["hip_patient_nm"].null_count == np.count_nonzero(~is_split) > 0
        np.testing.assert_array_equal(table["hip_patient_nm"].to_numpy(), patient)
        assert table["status"].to_pylist() == expected.status.tolist()
        assert all(field.metadata[b"meaning"] for field in table.schema)
        assert table.schema.field("slide_net_n").metadata[b"unit"] == b"N"
        assert table.schema.metadata[b"gaitd.session"].decode() == session
    assert len({one["file"] for one in first.values()}) == CSV_COUNT


@pytest.mark.usefixtures("threads")
def test_results_are_made_once_for_a_robot_file(sessions, made, tmp_path):
    output = tmp_path / "out"
    shutil.copytree(made[0], output)
    torn, *_ = sorted(output.iterdir())
    torn.write_bytes(torn.read_bytes()[:-100])
    ended, again = fleet(sessions, output, "--workers", 1)

    assert ended.code == 1
    assert f"{torn}: is no whole Parquet file; delete it" in ended.err
    assert sum(one["kept"] for one in again.values()) == CSV_COUNT - 1
    other = tmp_path / "robot.toml"
    other.write_text(ROBOT.read_text() + "\n# another file\n")
    changed = fleet(sessions, output, "--workers", 1, robot=other)[1]
    assert not any(one["kept"] for one in changed.values())
    assert len(list(output.iterdir())) == 2 * CSV_COUNT


@pytest.mark.usefixtures("threads")
def test_results_of_two_robot_files_are_compared_recording_by_recording(
    sessions, made, five_columns, tmp_path
):
    """The second file has 2 N·m less friction of the hip."""
    other, picture, output = tmp_path / "robot.toml", tmp_path / "picture.png", tmp_path / "out"
    robot = ROBOT.read_text()
    assert robot.count("coulomb_nm = 6.0") == 1
    other.write_text(robot.replace("coulomb_nm = 6.0", "coulomb_nm = 4.0"))
    folders = [*sorted(sessions.iterdir()), five_columns]

    ended = gaitd(
        *("fleet", "estimate", *folders, "--robot", other, "--output", output, "--json"),
        *("--workers", 1, "--against", made[0], "--plot", picture),
    )

    told = json.loads(ended.out)
    assert ended.code == 1
    (missing,) = told["not_compared"]
    assert f"{made[0]}: has no other result of the recording of five.right." in missing
    (*of_one, hip, slide) = told["differences"]
    assert [one["recording"] for one in of_one[::2]] == [
        f"trainer{number // 2}/day{number % 2}" for number in range(CSV_COUNT)
    ]
    befores = [pq.read_table(one["file"]) for one in made[1].values()]
    new_files = {one["session"]: one["file"] for one in told["recordings"]}
    afters = [pq.read_table(new_files[session]) for session in made[1]]
    by = np.concatenate(
        [
            (new["hip_patient_nm"].to_numpy() - old["hip_patient_nm"].to_numpy())
            for old, new in zip(befores, afters, strict=True)
        ]
    )
    by = by[np.isfinite(by)]
    assert hip["both_ok_count"] == len(by) > 100
    assert hip["difference_mean_si"] == pytest.approx(np.mean(by))
    assert hip["difference_rms_si"] == pytest.approx(np.sqrt(np.mean(by**2)))
    assert hip["difference_rms_si"] > 5 * slide["difference_rms_si"]
    stds = np.concatenate([one["hip_patient_nm_std"].to_numpy() for one in befores])
    assert hip["sigma_before_si"] == pytest.approx(np.sqrt(np.nanmean(stds**2)), rel=0.05)
    assert 0 < hip["ok_after_ratio"] < 1
    assert picture.read_bytes().startswith(b"\x89PNG")
    counted = rows_of(f"SELECT count(*) FROM '{output}/estimate_differences.csv'")
    assert counted == [[len(told["differences"])]]

    again = gaitd(
        *("fleet", "estimate", *folders, "--robot", other, "--output", output),
        *("--workers", 1, "--against", output),
    )
    assert again.code == 1
    assert "only that of the same version and robot file" in again.out


def test_the_sql_of_the_document_works_on_the_results(made):
    output, results = made
    sql = re.search(r"```sql\n(.*?)```", FLEET_PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]

    rows = rows_of(sql, folder=output.parent)

    assert len(rows) == len(results)
    assert all(mean_nm > 0 for _, mean_nm in rows)


@pytest.mark.usefixtures("threads")
def test_all_files_of_a_folder_are_recordings_or_named(five_columns, tmp_path):
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    table = pq.read_table(five_columns)
    pq.write_table(table, mixed / "day0.parquet")
    shutil.copy(PUBLIC, mixed / "day2.parquet")  # its robot is one of an older version
    pq.write_table(table.replace_schema_metadata(None), mixed / "day1.PARQUET")
    (mixed / "notes.txt").write_text("none")

    ended = gaitd(
        *("fleet", "estimate", mixed, "--robot", ROBOT, "--output", tmp_path / "out"),
        *("--workers", 1),
    )

    assert "3 made, 0 kept, 0 failed" in ended.out
    assert f"{mixed}/notes.txt: left out" in ended.out
    assert ended.code == 0


def test_a_power_cut_leaves_a_whole_result_or_none(sessions, tmp_path, monkeypatch):
    made = results.Made(pa.table({"net": np.arange(500.0)}), 5.0)
    monkeypatch.setitem(results.MAKERS, results.Work.ESTIMATES, lambda *_: made)
    (tmp_path / "out").mkdir()
    session = sessions / "trainer0" / "day0.csv"
    job = results.Job(results.Work.ESTIMATES, session, None, "key", tmp_path / "out")

    def scenario():
        results.run_job(job, float)
        mark("made")

    def recover(marks):
        (result,) = results.run_job(job, float)
        assert (result.rows, result.error) == (500, "")
        assert result.kept or not marks
        assert pq.read_table(result.file) == made.table

    check(tmp_path / "out", scenario, recover)


@pytest.mark.usefixtures("threads")
def test_a_bad_recording_costs_itself(sessions, tmp_path):
    bad = tmp_path / "bad.csv"
    bad.write_text("no recording\n")

    ended = gaitd(
        *("fleet", "estimate", bad, *sorted(sessions.glob("*/day0.csv")), "--workers", 1),
        *("--robot", ROBOT, "--output", tmp_path / "out"),
    )

    assert ended.code == 1
    assert f"{bad}:1: lacks column" in ended.out
    assert "2 made, 0 kept, 1 failed" in ended.out


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--scheduler", "tcp://127.0.0.1:1", "--workers", "2"], "give one of both"),
        (["--scheduler", "nowhere:x"], "--scheduler: nowhere:x"),
        (["--robot", "none.toml"], "none.toml"),
        (["--against", "gone"], "--against: gone: is no folder"),
        (["--plot", "x.png"], "--plot: only of `gaitd fleet friction`, or with --against"),
    ],
)
def test_what_cannot_be_is_refused(sessions, tmp_path, more, words):
    ended = gaitd(
        *("fleet", "estimate", sessions / "trainer0", "--output", tmp_path / "out"),
        *("--robot", ROBOT, *more),
    )

    assert ended.code == 2
    assert words in ended.err


# --- losses --------------------------------------------------------------------------------------


class Cluster:
    """A scheduler and two workers of Dask's own commands."""

    def __init__(self, folder):
        self.file = folder / "scheduler.json"
        self.scheduler = self._started("scheduler", "--host", "127.0.0.1", "--port", "0")
        self.workers = [
            self._started("worker", "--nthreads", "1", "--no-nanny", "--name", name)
            for name in ("first", "second")
        ]

    def _started(self, kind, *more):
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", "--no-dashboard"]
        log = self.file.with_name(f"{kind}.log").open("a")
        # The modules of these tests are no package of the workers; gaitd is.
        return subprocess.Popen(
            [*command, "--scheduler-file", str(self.file), *more],
            stdout=log,
            stderr=log,
            env={**os.environ, "PYTHONPATH": ""},
        )

    @property
    def address(self):
        """Address of the scheduler, once all workers are there."""
        from distributed import Client

        while not self.file.exists() or not self.file.read_text():
            assert self.scheduler.poll() is None
            time.sleep(0.05)
        with Client(scheduler_file=str(self.file)) as client:
            client.wait_for_workers(2)
            return client.scheduler.address

    def end(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    made = Cluster(tmp_path)
    yield made
    made.end()


def lose(cluster, output):
    """Stop the second worker when it has made a result, and kill the scheduler."""
    end_s = time.monotonic() + 120
    while not list(output.glob("*.parquet")):
        assert time.monotonic() < end_s
        time.sleep(0.05)
    cluster.workers[1].send_signal(signal.SIGSTOP)
    cluster.scheduler.kill()


@pytest.mark.usefixtures("threads")
def test_a_lost_scheduler_costs_nothing_that_was_finished(sessions, made, tmp_path, cluster):
    """What Dask does for a worker that is lost is left to its own tests."""
    address = cluster.address
    cluster.workers[0].send_signal(signal.SIGSTOP)  # it takes tasks, and does none
    output = tmp_path / "results"
    folders = sorted(sessions.iterdir())
    words = ("fleet", "estimate", *folders, "--robot", ROBOT, "--output", output)
    with ThreadPoolExecutor(1) as beside:
        lost = beside.submit(lose, cluster, output)
        ended = gaitd(*words, "--scheduler", address)
        lost.result()

    finished = {file.name: file.read_bytes() for file in output.glob("*.parquet")}
    assert ended.code == 1, ended.err
    assert 0 < len(finished) < CSV_COUNT  # the first worker holds some
    assert "the scheduler was lost; the same call again does what is missing" in ended.out
    assert "Traceback" not in ended.out
    assert finished == {name: (made[0] / name).read_bytes() for name in finished}
    again = fleet(sessions, output, "--workers", 1)[1]
    assert sum(one["kept"] for one in again.values()) == len(finished)
    assert not any(one["error"] for one in again.values())
