"""A test of a warm session runs in a fork: its changes end with it, its failure is reported."""

from pathlib import Path

pytest_plugins = ["pytester"]

SUPPORT = Path(__file__).with_name("support")
CONFTEST = f"""
import sys

sys.path.insert(0, {str(SUPPORT)!r})
pytest_plugins = ["forked"]
"""
TESTS = """
import os
import pytest

@pytest.fixture(scope="module")
def warm_list():
    return [1]

@pytest.fixture
def through(warm_list):
    return warm_list

def test_changes(warm_list):
    warm_list.append(2)
    assert warm_list == [1, 2]

def test_sees_no_change_of_another(through):
    assert through == [1]

def test_fails(warm_list):
    seen = [*warm_list, 7]
    assert seen == [1]

def test_skips(warm_list):
    pytest.skip("not here")

def test_dies(warm_list):
    os.kill(os.getpid(), 9)

def test_prints(warm_list):
    print("said in the fork")
    raise KeyError("a key")

@pytest.mark.timeout(1)
def test_hangs(warm_list):
    while True:
        pass

def test_without_stays_in_this_process():
    assert os.getpid() == int(os.environ["PYTEST_PID"])
"""


def test_what_happens_in_a_fork_is_reported_and_changes_nothing_here(pytester):
    pytester.makeconftest(CONFTEST + "\nimport os\nos.environ['PYTEST_PID'] = str(os.getpid())\n")
    pytester.makepyfile(TESTS)

    ran = pytester.runpytest_subprocess("-p", "no:cacheprovider", "-p", "no:xdist")

    said = ran.stdout.str()
    ran.assert_outcomes(passed=3, failed=4, skipped=1)
    assert "assert [1, 7] == [1]" in said
    assert "signal 9" in said
    assert "said in the fork" in said
    assert "KeyError: 'a key'" in said
    assert "Timeout (>1" in said
