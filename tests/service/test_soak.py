"""Half a minute of `gaitd soak`, as a person runs it."""

import json
import subprocess
import sys

import pytest

pytestmark = pytest.mark.realtime

SEED = 3
"""Faults of drives only within its first half minute: no process is killed."""


@pytest.fixture(scope="module")
def soaked(tmp_path_factory):
    """What it said, and its page."""
    page = tmp_path_factory.mktemp("soak") / "page.md"
    words = ["soak", "--minutes", "0.5", "--seed", str(SEED), "--json", "--report", str(page)]
    ran = subprocess.run(
        [sys.executable, "-m", "gaitd", *words],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert ran.stdout, ran.stderr
    return json.loads(ran.stdout), page, ran.returncode


@pytest.mark.timeout(320)
def test_a_soak_walks_goes_wrong_and_walks_again(soaked):
    found = soaked[0]

    assert found["cycle_count"] > 1000
    assert found["troubles"]
    assert found["requests"]["mode done"] >= 1


@pytest.mark.timeout(320)
def test_every_stop_of_a_soak_is_explained_and_nothing_ends_by_itself(soaked):
    found, _, code = soaked

    assert {stop["judged"] for stop in found["stops"]} <= {"expected", "the computer held us up"}
    assert found["endings"] == []
    assert found["exit_codes"] == {"core": 0, "gateway": 0, "sim": 0}
    assert code == (1 if found["failures"] else 0)


@pytest.mark.timeout(320)
def test_memory_of_every_process_is_told(soaked):
    lives = soaked[0]["memory"]

    assert {life["name"] for life in lives} == {"sim", "core", "gateway"}
    assert all(life["end_mb"] > 10 for life in lives)


@pytest.mark.timeout(320)
def test_a_soak_leaves_a_page_and_its_picture(soaked):
    page = soaked[1]

    text = page.read_text()
    assert "# The soak" in text
    assert "SYNC late" in text
    assert f"({page.with_suffix('.png').name})" in text
    assert page.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
