"""The demonstration as a person runs it: real processes, simulated time, a real end."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from urllib.request import urlopen

import pytest

from gaitd_lab.processes import free_port

pytestmark = pytest.mark.timeout(400)
DEMO = [sys.executable, "-m", "gaitd", "demo", "--headless"]
AT_MOST = [*DEMO, "--pace", "max"]
NO_PAGE = ("--engineer-port", "0")
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
        [*DEMO, *NO_PAGE, "--seconds", "15", "--plot", str(picture), *more],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


@contextmanager
def walking(picture: Path):
    """A demonstration whose gait has been announced, its processes, and its engineer's page."""
    port = free_port()
    with subprocess.Popen(
        [*AT_MOST, "--plot", str(picture), "--engineer-port", str(port)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        # Who runs the tests in the background of a shell ignores SIGINT, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    ) as demo:
        assert demo.stdout is not None
        assert demo.stdout.readline() == f"the engineer's page: http://127.0.0.1:{port}/\n"
        for line in demo.stdout:
            if "gait is announced" in line:
                break
        yield demo, descendants(demo.pid), f"http://127.0.0.1:{port}"


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    picture = tmp_path_factory.mktemp("demo") / "new" / "demo.png"
    return play(picture, "--pace", "max", "--json"), picture


def test_the_demonstration_plays_judges_and_draws(played):
    ran, picture = played

    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "all within bounds, no stop" in ran.stderr
    assert f"picture: {picture}" in ran.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert len(dict(printed_errors(ran.stderr))) == 4, ran.stderr
    assert json.loads(ran.stdout)["picture"] == str(picture)


@pytest.mark.thorough
def test_a_second_demonstration_finds_the_same_errors(played, tmp_path):
    again = play(tmp_path / "again.png", "--pace", "max")

    assert dict(printed_errors(again.stdout)) == pytest.approx(
        dict(printed_errors(played[0].stderr)), rel=AGREEMENT_RATIO, abs=ROUNDING
    )


@pytest.mark.realtime
def test_by_the_wall_clock_the_demonstration_shows_how_late_its_cycles_were(tmp_path):
    ran = play(tmp_path / "demo.png", "--wall-clock")

    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "overruns" in ran.stdout


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.thorough)]
)
def test_an_interrupted_demonstration_ends_its_processes_and_says_so(tmp_path, number):
    with walking(tmp_path / "demo.png") as (demo, processes, _):
        demo.send_signal(number)
        rest = demo.stdout.read()

    assert demo.returncode == 1
    assert "interrupted" in rest
    assert "Traceback" not in rest
    assert len(processes) == 5, "virtual drives, service, core, gateway, engineer's page"
    assert not any(map(lives, processes))


def known_truth(address: str) -> bool:
    """True if the page has a true effort of the patient at the SYNC of an estimate."""
    with urlopen(f"{address}/past.json", timeout=10) as answer:
        past = json.load(answer)
    at = past["columns"].index("hip_true_nm")
    return any(row[at] is not None for row in past["rows"]["right"])


def test_the_engineers_page_shows_the_demonstration_beside_the_truth_and_may_end(tmp_path):
    with walking(tmp_path / "demo.png") as (demo, processes, address):
        with urlopen(address, timeout=10) as answer:
            assert "<title>gaitd live</title>" in answer.read().decode()
        end_s = time.monotonic() + 60
        while not known_truth(address):
            assert time.monotonic() < end_s
            time.sleep(0.1)
        (page,) = [pid for pid in processes if runs(pid, "gaitd_lab.demonstration.client_process")]
        os.kill(page, signal.SIGKILL)
        time.sleep(1)
        assert demo.poll() is None
        demo.send_signal(signal.SIGINT)
        assert "interrupted" in demo.stdout.read()


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


def session(*more):
    """A training session, whose pages take any free port."""
    return [*AT_MOST, "--session", "--patient-port", str(free_port()), *NO_PAGE, *more]


def test_a_training_session_is_walked_on_the_pages_of_patient_and_therapist():
    with socket.create_server(("127.0.0.1", 0)) as busy:
        ran = subprocess.run(
            session("--therapist-port", str(busy.getsockname()[1]), "--json"),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )

    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "3 blocks walked, no interruption" in ran.stderr
    told = json.loads(ran.stdout)
    assert (told["passed"], told["trouble"], told["picture"]) == (True, "", None)
    summary, blocks = told["session"]["summary"], told["session"]["blocks"]
    assert (summary["end"], summary["interruption_count"]) == ("complete", 0)
    assert summary["walked_s"] >= 6 + 8 + 8 - 2 * 3, "a block with 2 s left is complete"
    assert [len(block["shares"]) > 0 for block in blocks] == 3 * [True]
    assert summary["valid_count"] == sum(len(block["shares"]) for block in blocks)
    scenes = re.findall(r"^--- (.*)$", ran.stderr, re.M)
    expected = ["daily test: the emergency stop", "self-test", "block 1 of 3", "block 3 of 3"]
    places = [next(at for at, one in enumerate(scenes) if text in one) for text in expected]
    assert places == sorted(places)


def test_an_interrupted_training_ends_its_processes_within_its_time():
    with subprocess.Popen(
        session(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    ) as demo:
        for line in demo.stdout:
            if "motion is announced" in line:
                break
        processes = descendants(demo.pid)
        demo.send_signal(signal.SIGINT)
        rest = demo.stdout.read()

    assert demo.returncode == 1
    assert "interrupted" in rest
    assert "session left: walked 0 s" in rest, "the page's server has ended in order"
    assert "Traceback" not in rest
    assert len(processes) == 6, "virtual drives, service, core, gateway, two pages"
    assert not any(map(lives, processes))
