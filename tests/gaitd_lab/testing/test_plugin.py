"""The plugin as an outsider meets it: files of their own, run by a pytest of their own."""

import contextlib
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

PROJECT = Path(__file__).parents[3]
GUIDE = PROJECT / "docs" / "integrating.md"
EXAMPLE = re.compile(r"<!-- example: (\w+\.py) -->\n```python\n(.*?)```\n<!-- end -->", re.S)
EXAMPLES = dict(EXAMPLE.findall(GUIDE.read_text()))
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}
"""Without the options that our pytest was given."""
HOME = str(Path.home())
SHORT = ("-p", "gaitd_lab.testing.plugin", "-p", "no:cacheprovider", "-ra")
"""The plugin by name: this tree's, also where an older one is installed."""


def has_socketcan():
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def alive(pid):
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    return False


@pytest.fixture
def outsider(pytester, monkeypatch):
    """A folder of their own; runs its test files in a process of their own."""
    monkeypatch.setenv("HOME", HOME)  # pytester's is empty: what was compiled is not there

    def run(*arguments, **files):
        pytester.makepyfile(**files)
        return pytester.runpytest_subprocess(*SHORT, *arguments)

    return run


PASSED = {"test_display.py": 3, "test_time.py": 2, "test_configured.py": 4, "test_machines.py": 3}


@pytest.mark.thorough
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", sorted(EXAMPLES.keys() - {"test_own_node.py"}))
def test_every_example_of_the_guide_runs_as_it_is_printed(outsider, name):
    """That with a node of its own runs in the rig, and below without one."""
    ran = outsider(**{name.removesuffix(".py"): EXAMPLES[name]})

    ran.assert_outcomes(passed=PASSED[name])


FAILING = """
import pytest

def test_failing(virtual_trainer):
    with open("left", "w") as file:
        pids = [str(process.pid) for process in virtual_trainer.parts.values()]
        print(virtual_trainer.folder, *pids, file=file)
    virtual_trainer.kill("gateway", 19)  # stopped, it obeys nothing
    assert False, "as it was meant to"

@pytest.mark.virtual_trainer({"demo.toml": {"gait.announced_s": 1.0}})
def test_mistyped(virtual_trainer):
    pass

def test_refused_a_vcan(vcan, monkeypatch):
    pass

@pytest.mark.rig_vcan
def test_left_out():
    pass
"""


USER_OF_NOTHING = """
import sys

def test_that_wants_nothing_of_ours_gets_nothing():
    ours = {"daemon", "sim_drives", "gaitd_lab.testing.trainer", "numpy", "zenoh", "can"}
    assert not ours & set(sys.modules)
"""


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """A run of tests that fail in every way: its folder, its output."""
    folder = tmp_path_factory.mktemp("failed")
    (folder / "test_a_nothing.py").write_text(USER_OF_NOTHING)
    (folder / "test_failing.py").write_text(FAILING)
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", *SHORT, "--gaitd-rigs=none"],
        cwd=folder,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    return folder, ran.stdout


@pytest.mark.timeout(600)
def test_what_the_processes_said_stands_in_the_report_of_a_failing_test(failed):
    report = failed[1].split("_ test_failing _")[1].split("_ ERROR")[0].split("_ test_")[0]

    assert "as it was meant to" in report
    for part in ("sim", "core", "gateway"):
        assert f"gaitd {part} (virtual trainer)" in report
    assert "virtual drives right/hip, right/slide on" in report


@pytest.mark.timeout(600)
def test_nothing_is_left_of_a_test_that_failed(failed):
    folder, *pids = (failed[0] / "left").read_text().split()

    assert len(pids) == 3
    assert not [pid for pid in pids if alive(pid)]
    assert not Path(folder).exists()


@pytest.mark.timeout(600)
def test_a_key_that_is_not_there_is_named(failed):
    assert "EditError: demo.toml has no key gait.announced_s" in failed[1]


@pytest.mark.timeout(600)
def test_a_test_without_our_fixtures_imports_nothing_of_ours(failed):
    assert "test_a_nothing.py ." in failed[1]


@pytest.mark.timeout(600)
def test_a_rig_that_is_left_out_is_said_in_one_line(failed):
    assert "not used: rig_vcan: left out by --gaitd-rigs=none" in failed[1]


def test_where_there_is_no_vcan_the_reason_and_the_way_out_are_one_line(pytester):
    if has_socketcan() and os.geteuid() == 0:
        pytest.skip("there is one here")
    pytester.makepyfile(test_own_node="def test_bus(vcan):\n    pass\n")
    ran = pytester.runpytest_inprocess(*SHORT, "--gaitd-rigs=required")

    ran.assert_outcomes(errors=1)
    ran.stdout.fnmatch_lines(
        ["*required, but vcan: *`gaitd rig vcan -- pytest test_own_node.py` has one*"]
    )


@pytest.mark.rig_vcan
@pytest.mark.timeout(900)
def test_an_outsiders_file_runs_in_the_rig_as_it_is(tmp_path):
    """One boot: their folder is theirs to write to, and the exit code is pytest's."""
    (tmp_path / "test_own_node.py").write_text(EXAMPLES["test_own_node.py"])
    (tmp_path / "test_fails.py").write_text("def test_fails():\n    assert False\n")
    words = ["pytest", *SHORT, "--junit-xml=report.xml"]

    ran = subprocess.run(
        [sys.executable, "-m", "gaitd", "rig", "vcan", "--", *words],
        cwd=tmp_path,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=850,
        check=False,
    )

    assert "1 failed, 1 passed" in ran.stdout, ran.stdout + ran.stderr
    assert ran.returncode == 1
    assert 'tests="2"' in (tmp_path / "report.xml").read_text()
