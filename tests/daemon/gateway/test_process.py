"""`gaitd gateway` as a process, and the commands that talk to it."""

import itertools
import json
import resource
import subprocess
import time
from pathlib import Path

import command_line
import pytest
from processes import CONFIGS, gaitd

from daemon.config.edits import edit
from gaitd_lab.processes import GAITD, ManagedProcess

realtime = pytest.mark.realtime


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


def ask(name: str, config: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return gaitd(name, "--config", str(config), *arguments)


def heaps_of_threads(pid: int) -> list[str]:
    """What glibc reserves for a heap beside the first: 64 MB, most of it out of reach."""
    rows = (row.split() for row in Path(f"/proc/{pid}/maps").read_text().splitlines())
    reserved = [places for places, access, *_ in rows if access == "---p"]
    return [one for one in reserved if _size(one) > 32 << 20]


def _size(places: str) -> int:
    begin, end = (int(place, 16) for place in places.split("-"))
    return end - begin


@realtime
def test_all_threads_of_the_gateway_share_one_heap_however_many_have_connected(
    process, config, start_core
):
    start_core()
    for _ in range(3):
        assert ask("status", config).returncode == 0

    assert len(list(Path(f"/proc/{process.pid}/task").iterdir())) > 2
    assert not heaps_of_threads(process.pid)


def test_a_gateway_without_descriptors_reports_it_once_with_what_to_do(process, config, eventually):
    log = config.with_suffix(".log")
    ask("status", config)
    limits = resource.prlimit(process.pid, resource.RLIMIT_NOFILE)
    used = {int(one.name) for one in Path(f"/proc/{process.pid}/fd").iterdir()}
    lowest = next(number for number in itertools.count() if number not in used)
    resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (lowest, limits[1]))
    eventually(lambda: "no file descriptor left" in log.read_text(), 20)
    resource.prlimit(process.pid, resource.RLIMIT_NOFILE, limits)

    eventually(lambda: "has file descriptors again" in log.read_text(), 20)
    assert log.read_text().count("no file descriptor left") == 1


@realtime
def test_sigterm_ends_the_gateway_with_0_and_leaves_no_socket(process, runtime, start_core):
    start_core()
    time.sleep(0.2)

    begun = time.monotonic()

    assert process.end() == 0
    assert time.monotonic() - begun < 2.0
    assert not (runtime / "gateway.sock").exists()
    assert not (runtime / "zenoh.sock").exists()
    assert 'text="the control program runs: Leg is held"' in process.output()


@realtime
def test_the_commands_end_with_0_when_done_and_with_1_when_refused(process, config, start_core):
    from gaitd_names import Outcome, RefusalCode

    from daemon.ipc.report import Refusal

    core = start_core()
    core.answer("enable", Outcome.DONE)
    core.answer("mode", Outcome.REFUSED, Refusal(RefusalCode.LEG_MOVES))

    enabled = ask("enable", config)
    gait = ["gait", "--cadence", "0.25", "--amplitude", "1", "--duration", "20"]
    refused = gaitd("mode", *gait, "--config", str(config))
    stopped = ask("stop", config, "--json")

    assert (enabled.returncode, enabled.stdout) == (0, "enable done (mode hold)\n")
    assert (refused.returncode, refused.stdout) == (
        1,
        "mode refused: the leg is moving (mode hold)\n",
    )
    assert core.requests[1].mode.duration_s == 20
    assert stopped.returncode == 0
    assert json.loads(stopped.stdout)["outcome"] == "done"


@realtime
def test_a_mode_that_does_not_exist_is_refused_with_those_that_do(process, config, start_core):
    start_core()

    refused = gaitd("mode", "dance", "--config", str(config))

    assert refused.returncode == 1
    assert "dance" in refused.stdout


@realtime
def test_status_shows_mode_drives_legs_and_events(process, config, start_core, make_record):
    start_core()
    time.sleep(0.2)

    shown = ask("status", config)

    assert shown.returncode == 0
    for words in ("mode         hold", "right/hip", "patient 8.0 N·m (ok)", "core is there"):
        assert words in shown.stdout


@realtime
def test_status_without_a_core_says_so(process, config):
    shown = ask("status", config)

    assert shown.returncode == 4
    assert "no records arrive from the core" in shown.stdout


@pytest.mark.parametrize("name", ["status", "stop"])
def test_without_a_service_a_command_names_the_endpoint_and_ends_with_4(config, runtime, name):
    silent = command_line.gaitd(name, "--config", config)

    assert silent.code == 4
    assert str(runtime / "zenoh.sock") in silent.err


@realtime
def test_a_service_of_another_name_does_not_answer(process, config, runtime):
    endpoint = f"unixsock-stream/{runtime}/zenoh.sock"

    silent = gaitd("stop", "--endpoint", endpoint, "--trainer", "another", "--json")

    assert silent.returncode == 4
    assert json.loads(silent.stdout)["outcome"] == "unanswered"
    assert "gaitd/another/control/stop" in silent.stdout


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


@realtime
def test_a_gateway_that_was_killed_does_not_keep_the_next_one_from_starting(
    process, config, runtime, start_core, eventually
):
    start_core()
    process.kill()
    process.wait()
    assert (runtime / "zenoh.sock").exists()

    second = gateway(config)
    eventually(lambda: ask("status", config).returncode == 0, within_s=20)
    assert second.end() == 0
