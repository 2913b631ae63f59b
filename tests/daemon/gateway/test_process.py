"""`gaitd gateway` as a process, and the commands that talk to it."""

import itertools
import resource
from pathlib import Path

import command_line
import pytest
from command_line import Ended
from processes import CONFIGS, gaitd

from daemon.config.edits import edit
from gaitd_lab.processes import GAITD, ManagedProcess


def trainer_file(runtime: Path, listen: str) -> Path:
    """The demonstration's file, with a folder of records and an endpoint of its own."""
    file = runtime / "trainer.toml"
    file.write_bytes((CONFIGS / "demo.toml").read_bytes())
    places = {"paths.runtime": str(runtime), "paths.state": f"{runtime}-state"}
    edit(runtime, {file.name: {**places, "zenoh.listen": [listen]}})
    return file


@pytest.fixture
def config(runtime):
    return trainer_file(runtime, f"unixsock-stream/{runtime}/zenoh.sock")


def gateway(config):
    words = (*GAITD, "gateway", "--config", str(config))
    return ManagedProcess("gaitd gateway", words, config.with_suffix(".log"))


@pytest.fixture
def process(config, runtime, eventually):
    started = gateway(config)
    eventually((runtime / "zenoh.sock").exists, within_s=20)
    yield started
    started.end()


def ask(name: str, config: Path) -> Ended:
    return command_line.gaitd(name, "--config", config)


def heaps_of_threads(pid: int) -> list[str]:
    """What glibc reserves for a heap beside the first: 64 MB, most of it out of reach."""
    rows = (row.split() for row in Path(f"/proc/{pid}/maps").read_text().splitlines())
    reserved = [places for places, access, *_ in rows if access == "---p"]
    return [one for one in reserved if _size(one) > 32 << 20]


def _size(places: str) -> int:
    begin, end = (int(place, 16) for place in places.split("-"))
    return end - begin


def test_a_gateway_without_descriptors_reports_it_once_with_what_to_do(process, config, eventually):
    log = config.with_suffix(".log")
    ask("status", config)
    limits = resource.prlimit(process.pid, resource.RLIMIT_NOFILE)

    def is_without():
        """Again and again: the client's descriptor is closed a moment after the client has gone."""
        used = {int(one.name) for one in Path(f"/proc/{process.pid}/fd").iterdir()}
        lowest = next(number for number in itertools.count() if number not in used)
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (lowest, limits[1]))
        return "no file descriptor left" in log.read_text()

    eventually(is_without, 20)
    resource.prlimit(process.pid, resource.RLIMIT_NOFILE, limits)

    eventually(lambda: "has file descriptors again" in log.read_text(), 20)
    assert log.read_text().count("no file descriptor left") == 1


def test_without_a_service_a_command_names_the_endpoint_and_ends_with_4(config, runtime):
    silent = command_line.gaitd("stop", "--config", config)

    assert silent.code == 4
    assert str(runtime / "zenoh.sock") in silent.err


def test_an_endpoint_that_another_machine_could_reach_is_a_configuration_error(
    runtime, monkeypatch
):
    monkeypatch.setattr("daemon.gateway.process.share_one_heap", lambda: None)

    refused = command_line.gaitd("gateway", "--config", trainer_file(runtime, "tcp/0.0.0.0:7447"))

    assert refused.code == 2
    assert "zenoh.listen[0]" in refused.err
    assert "listen_beyond_loopback" in refused.err


def test_a_socket_that_cannot_be_had_is_said_with_its_endpoint(runtime):
    nowhere = f"unixsock-stream/{runtime}/nowhere/zenoh.sock"

    refused = gaitd("gateway", "--config", str(trainer_file(runtime, nowhere)))

    assert refused.returncode == 2
    assert "nowhere/zenoh.sock" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_a_gateway_after_a_killed_one_serves_from_one_heap_and_ends_with_0_and_without_a_socket(
    process, config, runtime, start_core, eventually
):
    start_core()
    process.kill()
    process.wait()
    assert (runtime / "zenoh.sock").exists()

    second = gateway(config)
    eventually(lambda: ask("status", config).code == 0, within_s=20)
    for _ in range(2):
        assert ask("status", config).code == 0
    threads = list(Path(f"/proc/{second.pid}/task").iterdir())
    heaps = heaps_of_threads(second.pid)

    assert second.end() == 0
    assert len(threads) > 2
    assert not heaps
    assert not (runtime / "gateway.sock").exists()
    assert not (runtime / "zenoh.sock").exists()
    assert 'text="the control program runs: Leg is held"' in second.output()
