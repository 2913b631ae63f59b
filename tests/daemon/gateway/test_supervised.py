"""What the gateway tells who supervises it (sd_notify(3)), from its own loop."""

import contextlib
import socket

import pytest
from processes import CONFIGS

from daemon.config.trainer import load_trainer
from daemon.gateway.process import serve
from daemon.gateway.reload import Reload
from daemon.system.clock import MonotonicClock
from gaitd_lab.processes import free_port

TURNS = 40
"""Of at most 20 ms: longer than the half second between two words."""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """All words of a gateway that runs for some turns, without a core."""
    tmp_path = tmp_path_factory.mktemp("run")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as supervisor:
        supervisor.bind(str(tmp_path / "notify"))
        supervisor.setblocking(False)
        turns = iter(range(TURNS))
        file = load_trainer(CONFIGS / "demo.toml")
        serve(
            "trainer",
            [f"tcp/127.0.0.1:{free_port()}"],
            tmp_path,
            tmp_path / "state",
            MonotonicClock(),
            lambda: next(turns, None) is None,
            file.trainer.lease,
            str(tmp_path / "notify"),
            Reload(file, load_trainer),
            lambda: None,
        )
        words = []
        with contextlib.suppress(BlockingIOError):
            while True:
                words += supervisor.recv(4096).decode().splitlines()
    return words


def test_it_is_ready_once_feeds_the_watchdog_from_its_loop_and_says_that_it_stops(told):
    assert told[0] == "READY=1"
    assert told[-1] == "STOPPING=1"
    assert told.count("READY=1") == told.count("STOPPING=1") == 1
    assert told.count("WATCHDOG=1") >= 1


def test_its_status_says_that_no_core_is_heard(told):
    assert "STATUS=no records from a core" in told
