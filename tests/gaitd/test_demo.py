"""The demonstration as a person runs it: real processes, real time, a real end."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(400)]
DEMO = [sys.executable, "-m", "gaitd", "demo", "--headless"]


def descendants(pid: int) -> list[int]:
    """All processes below one."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [*map(int, children), *(one for child in children for one in descendants(int(child)))]


def lives(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def test_the_demonstration_plays_judges_and_draws(tmp_path):
    picture = tmp_path / "new" / "demo.png"

    ran = subprocess.run(
        [*DEMO, "--seconds", "15", "--plot", str(picture)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )

    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "all within bounds, no stop" in ran.stdout
    assert "gait, the patient takes part" in ran.stdout
    assert "overruns" in ran.stdout
    assert f"picture: {picture}" in ran.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_demonstration_ends_its_processes_and_says_so(tmp_path, number):
    with subprocess.Popen(
        [*DEMO, "--plot", str(tmp_path / "demo.png")],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        # Who runs the tests in the background of a shell ignores SIGINT, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    ) as demo:
        assert demo.stdout is not None
        for line in demo.stdout:
            if "gait is announced" in line:
                break
        troupe = descendants(demo.pid)
        demo.send_signal(number)
        rest = demo.stdout.read()

    assert demo.returncode == 1
    assert "interrupted" in rest
    assert "Traceback" not in rest
    assert len(troupe) == 4, "virtual drives, service, core, gateway"
    assert not any(map(lives, troupe))
