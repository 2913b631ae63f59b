"""What the gateway tells who supervises it (sd_notify(3)), from its own loop."""

import contextlib
import signal
import socket

import command_line
import pytest
import zenoh
from gaitd_toml import ConfigError
from processes import CONFIGS

from daemon.config.edits import edit
from daemon.config.trainer import load_trainer
from daemon.gateway.process import serve
from daemon.gateway.reload import Reload
from daemon.system.clock import MonotonicClock
from gaitd_lab.processes import free_port

TURNS = 40
"""Each takes at most 20 ms: longer than the half second between two words."""


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
        return received(supervisor)


def received(supervisor):
    """All words that have arrived."""
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


@pytest.fixture
def _signals():
    """The handlers of before: the command sets its own."""
    kept = {one: signal.getsignal(one) for one in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)}
    yield
    for one, handler in kept.items():
        signal.signal(one, handler)


@pytest.mark.usefixtures("_signals")
def test_a_restarted_gateway_that_cannot_listen_feeds_the_watchdog_and_tries_again(
    runtime, capfd, monkeypatch
):
    """Without a word the supervisor would kill it, and the clients would lose their STOP."""
    config = runtime / "demo.toml"
    config.write_bytes((CONFIGS / "demo.toml").read_bytes())
    places = {"paths.runtime": str(runtime / "run"), "paths.state": str(runtime / "state")}
    edit(runtime, {config.name: places})
    runs = iter([True, zenoh.ZError("in use"), ConfigError(config, "zenoh", "x", "y"), False])
    fed = []

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as supervisor:
        supervisor.bind(str(runtime / "notify"))
        supervisor.setblocking(False)

        def run(*_):
            fed.append(received(supervisor))
            result = next(runs)
            if isinstance(result, Exception):
                raise result
            return result

        monkeypatch.setenv("NOTIFY_SOCKET", str(runtime / "notify"))
        monkeypatch.setattr("daemon.gateway.process.serve", run)
        monkeypatch.setattr("daemon.gateway.process.share_one_heap", lambda: None)
        monkeypatch.setattr("daemon.gateway.log.begin", lambda *_: None)
        monkeypatch.setattr("gaitd.gateway.RETRY_S", 0.0)
        ended = command_line.gaitd("gateway", "--config", config)

    said = ["WATCHDOG=1", "STATUS=cannot listen; tries again"]
    assert fed == [[], [], said, said]
    assert ended.code == 0
    assert capfd.readouterr().err.count("tries again") == 2
    assert next(runs, None) is None
