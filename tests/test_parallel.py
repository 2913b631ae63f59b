"""Tests on several processors: each runs once, and what must be alone when the rest is over."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from outsiders import ENVIRONMENT
from parallel import ALONE, LAST, LONG, scope_of

PROJECT = Path(__file__).resolve().parent.parent
PLUGIN = """
import sys
import pytest
sys.path.insert(0, {support!r})

def pytest_xdist_make_scheduler(config, log):
    from parallel import AloneLast
    return AloneLast(config, log)
"""
NOTED = """
import json, os, time
import pytest

@pytest.mark.parametrize("number", range({count}))
def test_one(number):
    begun = time.monotonic()
    time.sleep(0.05)
    worker = os.environ["PYTEST_XDIST_WORKER"]
    with open({log!r}, "a") as file:
        file.write(json.dumps([{name!r}, number, worker, begun, time.monotonic()]) + "\\n")
"""


@pytest.mark.parametrize("begin", [*ALONE, *LONG])
def test_every_beginning_is_that_of_a_file_that_is_there(begin):
    files = [file.relative_to(PROJECT).as_posix() for file in (PROJECT / "tests").rglob("*.py")]

    assert any(file.startswith(begin) for file in files)


REAL = re.compile(r"^from (processes|long_service|witnesses|bench_bus) import", re.M)


def test_what_starts_real_processes_of_the_service_is_alone():
    files = (PROJECT / "tests").rglob("test_*.py")
    real = [file.relative_to(PROJECT).as_posix() for file in files if REAL.search(file.read_text())]

    assert real
    assert not [file for file in real if scope_of(f"{file}::test") != LAST]


@pytest.fixture(scope="module")
def noted(tmp_path_factory):
    """Files of tests that note who ran them and when, run by three workers."""
    folder = tmp_path_factory.mktemp("several")
    log = folder / "log"
    support = str(PROJECT / "tests" / "support")
    (folder / "conftest.py").write_text(PLUGIN.format(support=support))
    counts = {
        "tests/service/test_a.py": 3,
        "tests/drives/test_b.py": 6,
        "tests/rigs/test_c.py": 2,
        "tests/faults/test_fault_matrix.py": 9,
        "tests/drives/test_d.py": 1,
    }
    for name, count in counts.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(NOTED.format(count=count, log=str(log), name=name))
    ran = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-n",
            "3",
            "--import-mode=importlib",
            "-p",
            "no:cacheprovider",
        ],
        cwd=folder,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout
    return counts, [json.loads(line) for line in log.read_text().splitlines()]


def test_every_test_runs_once(noted):
    counts, rows = noted

    wanted = [(name, number) for name, count in counts.items() for number in range(count)]
    assert sorted((name, number) for name, number, *_ in rows) == sorted(wanted)


def test_a_file_is_of_one_worker_and_a_long_one_of_several(noted):
    workers = {name: {row[2] for row in noted[1] if row[0] == name} for name in noted[0]}

    assert len(workers["tests/drives/test_b.py"]) == 1
    assert len(workers["tests/faults/test_fault_matrix.py"]) > 1


def test_what_is_alone_is_of_one_worker_and_begins_when_all_others_are_over(noted):
    alone = [row for row in noted[1] if scope_of(row[0]) == LAST]
    (keeper,) = {row[2] for row in alone}
    others = [row for row in noted[1] if row[2] != keeper]

    assert len(alone) == 5
    assert others
    assert max(row[4] for row in others) <= min(row[3] for row in alone)
