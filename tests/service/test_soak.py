"""A quarter of a minute of `gaitd soak`, as a person runs it."""

import json

import pytest
from processes import gaitd

SEED = 3
"""Within its first seconds a process is halted, and nothing is killed."""


def soak(page, *words):
    """What it said, its exit code, and its page."""
    told = ["soak", "--minutes", "0.25", "--seed", str(SEED), "--json", "--report", str(page)]
    ran = gaitd(*told, *words, timeout=300)
    assert ran.stdout, ran.stderr
    return json.loads(ran.stdout), ran.returncode, page.read_text()


@pytest.mark.thorough
@pytest.mark.timeout(320)
def test_a_soak_walks_goes_wrong_and_walks_again_and_every_stop_is_explained(tmp_path):
    page = tmp_path / "page.md"

    found, code, text = soak(page)

    assert found["cycle_count"] > 1000
    assert found["stops"]
    assert found["requests"]["mode done"] >= 2
    assert {stop["judged"] for stop in found["stops"]} == {"expected"}
    assert (found["failures"], found["endings"], code) == ([], [], 0)
    assert found["exit_codes"] == {"core": 0, "gateway": 0, "sim": 0}
    assert {life["name"] for life in found["memory"]} == {"sim", "core", "gateway"}
    assert all(life["end_mb"] > 10 for life in found["memory"])
    assert "# The soak" in text
    assert "× real time" in text
    assert f"({page.with_suffix('.png').name})" in text
    assert page.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.realtime
@pytest.mark.timeout(320)
def test_a_soak_by_the_computers_clock_tells_how_late_sync_was_and_excuses_no_stop_either(tmp_path):
    found, code, text = soak(tmp_path / "page.md", "--wall-clock")

    assert found["cycle_count"] > 1000
    assert found["lateness_us"]["1.0"] > 0
    assert "SYNC late" in text
    unexplained = [stop for stop in found["stops"] if stop["judged"] != "expected"]
    assert len(found["failures"]) >= len(unexplained)
    assert code == (1 if found["failures"] else 0)
