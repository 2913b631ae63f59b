"""The demonstration as a person runs it: real processes, simulated time, a real end."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import pytest
from command_line import gaitd

from gaitd_lab.demonstration.performance import Performance
from gaitd_lab.processes import free_port

pytestmark = pytest.mark.timeout(400)
DEMO = [sys.executable, "-m", "gaitd", "demo", "--headless"]
AGREEMENT_RATIO = 0.02
ROUNDING = 0.0101
"""Two printed numbers of two decimals differ by so much where the errors hardly do."""


def descendants(pid: int) -> list[int]:
    """All processes below one."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [*map(int, children), *(one for child in children for one in descendants(int(child)))]


def runs(pid: int, part: str) -> bool:
    return part in Path(f"/proc/{pid}/cmdline").read_text().split("\0")


def lives(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def printed_errors(text: str) -> list[tuple[str, float]]:
    """Every rms error of the table, by its row."""
    return [
        (f"{span} {axis}", float(rms))
        for span, axis, rms in re.findall(
            r"^ *(gait, .*?|the paper.*?)  +(hip|slide) +([\d.]+) N", text, re.M
        )
    ]


def play(picture: Path, *more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*DEMO, "--engineer-port", "0", "--seconds", "15", "--plot", str(picture), *more],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def known_truth(address: str) -> bool:
    """True if the page has a true effort of the patient at the SYNC of an estimate."""
    with urlopen(f"{address}/past.json", timeout=60) as answer:
        past = json.load(answer)
    at = past["columns"].index("hip_true_nm")
    return any(row[at] is not None for row in past["rows"]["right"])


@pytest.fixture
def in_process(monkeypatch):
    """The command leaves the signals of these tests alone."""
    monkeypatch.setattr("signal.signal", lambda *_: None)


def look_and_kill(address):
    """Open the engineer's page, wait until it knows the truth of an estimate, and kill it."""
    end_s = time.monotonic() + 120
    while True:
        with suppress(URLError, ConnectionError):
            with urlopen(address, timeout=60) as answer:
                title = answer.read().decode()
            break
        assert time.monotonic() < end_s
        time.sleep(0.05)
    while not known_truth(address):
        assert time.monotonic() < end_s
        time.sleep(0.05)
    client = "gaitd_lab.demonstration.client_process"
    (page,) = [pid for pid in descendants(os.getpid()) if runs(pid, client)]
    os.kill(page, signal.SIGKILL)
    return title


@pytest.mark.usefixtures("in_process")
def test_the_demonstration_plays_judges_and_draws_also_if_its_page_is_killed(tmp_path):
    port, picture = free_port(), tmp_path / "new" / "demo.png"
    words = ("--headless", "--pace", "max", "--seconds", 15, "--engineer-port", port, "--json")
    with ThreadPoolExecutor(1) as beside:
        page = beside.submit(look_and_kill, f"http://127.0.0.1:{port}")
        ran = gaitd("demo", *words, "--plot", picture)

    assert ran.code == 0, ran.out + ran.err
    assert "<title>gaitd live</title>" in page.result()
    assert f"the engineer's page: http://127.0.0.1:{port}/\n" in ran.err
    assert "all within bounds, no stop" in ran.err
    assert f"picture: {picture}" in ran.err
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert len(dict(printed_errors(ran.err))) == 4, ran.err
    assert json.loads(ran.out)["picture"] == str(picture)


@pytest.mark.thorough
def test_a_second_demonstration_finds_the_same_errors(tmp_path):
    first, again = (play(tmp_path / "one.png", "--pace", "max") for _ in range(2))

    assert dict(printed_errors(again.stdout)) == pytest.approx(
        dict(printed_errors(first.stdout)), rel=AGREEMENT_RATIO, abs=ROUNDING
    )


@pytest.mark.thorough
def test_a_patient_who_tires_gets_help_as_needed(tmp_path):
    ran = play(tmp_path / "tiring.png", "--tiring", "--seconds", "120", "--pace", "max")

    assert ran.returncode == 0, ran.stdout
    table = re.findall(r"^ *(\d+) +\S+ +\S+ +([\d.]+) +([\d.]+)", ran.stdout, re.M)
    guidance, assist_nm = zip(*((float(one), float(other)) for _, one, other in table), strict=True)
    assert min(guidance) < 0.6
    assert guidance[-1] > min(guidance)
    assert assist_nm[-1] > 5 * assist_nm[0]


# --- a training -----------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.usefixtures("in_process")
def test_a_training_session_is_walked_on_the_pages_of_patient_and_therapist():
    """The one that is interrupted has all its processes, `test_story.py` all its phases."""
    with socket.create_server(("127.0.0.1", 0)) as busy:
        ports = ("--patient-port", free_port(), "--therapist-port", busy.getsockname()[1])
        ran = gaitd("demo", "--session", "--pace", "max", "--engineer-port", 0, *ports, "--json")

    assert ran.code == 0, ran.out + ran.err
    assert "3 blocks walked, no interruption" in ran.err
    told = json.loads(ran.out)
    assert (told["passed"], told["trouble"], told["picture"]) == (True, "", None)
    summary, blocks = told["session"]["summary"], told["session"]["blocks"]
    assert (summary["end"], summary["interruption_count"]) == ("complete", 0)
    assert summary["walked_s"] >= 6 + 8 + 8 - 2 * 3, "a block with 2 s left is complete"
    assert [len(block["shares"]) > 0 for block in blocks] == 3 * [True]
    assert summary["valid_count"] == sum(len(block["shares"]) for block in blocks)
    scenes = re.findall(r"^--- (.*)$", ran.err, re.M)
    expected = ["daily test: the emergency stop", "self-test", "block 1 of 3", "block 3 of 3"]
    places = [next(at for at, one in enumerate(scenes) if text in one) for text in expected]
    assert places == sorted(places)


@pytest.fixture
def own_handler():
    """The command's handler of SIGTERM ends with the test."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.usefixtures("own_handler")
@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.thorough)]
)
def test_an_interrupted_training_ends_its_processes_within_its_time(number, monkeypatch):
    others, processes = descendants(os.getpid()), []

    def begin(performance, scene):
        begin_scene(performance, scene)
        if scene.title == "motion is announced":
            processes.extend(pid for pid in descendants(os.getpid()) if pid not in others)
            signal.raise_signal(number)

    begin_scene = Performance.begin
    monkeypatch.setattr(Performance, "begin", begin)
    ports = ("--patient-port", free_port(), "--therapist-port", free_port())
    ran = gaitd("demo", "--session", "--pace", "max", "--engineer-port", 0, *ports, "--json")

    told = json.loads(ran.out)
    assert (ran.code, told["passed"], told["picture"]) == (1, False, None)
    assert "interrupted" in told["trouble"]
    assert told["session"]["summary"]["end"] == "left", "the page's server has ended in order"
    assert "session left: walked 0 s" in ran.err
    assert "Traceback" not in ran.err
    assert len(processes) == 6, "virtual drives, service, core, gateway, two pages"
    assert not any(map(lives, processes))
