"""Clients that hang, die and come in numbers, and a network that is cut, while it walks.

The core must not notice any of them: nothing that it counts of requests and stops changes. The
gateway goes on answering others. Time is simulated, so the core waits for the gateway: that clients
take no processor time from the core is not shown here.
"""

import contextlib
import ctypes
import json
import os
import resource
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh
from fault_observations import Watch
from gaitd_client.connection import Target, client_settings
from gaitd_names import Cause, Mode
from long_service import TIMEOUT_S
from processes import Service

from gaitd_lab.testing.trainer import REST_CYCLES, STANDSTILL, speeds_by_leg

CONFIGURATION_ERROR = 2
SAMPLES = 100
COMING_AND_GOING = 5
HANDFUL = 4
PIDFD_GETFD = 438
"""System call number, the same on all architectures (Linux 5.6)."""
LISTENING, ESTABLISHED = "0A", "01"

PLAIN = """
import json, sys, time, zenoh
config = zenoh.Config.from_json5(json.dumps({
    "mode": "client", "connect": {"endpoints": [sys.argv[1]]},
    "scouting": {"multicast": {"enabled": False}}}))
session = zenoh.open(config)
"""
DEAF = (
    PLAIN
    + """
subscriber = session.declare_subscriber("gaitd/trainer/**", lambda sample: None)
print("hears", flush=True)
time.sleep(60)
"""
)
ASKS_AND_WAITS = (
    PLAIN
    + """
print("asks", flush=True)
for reply in session.get("gaitd/trainer/control/" + sys.argv[2], payload=sys.argv[3].encode()):
    print("answered", flush=True)
"""
)


@pytest.fixture
def walking(long_service):
    return long_service.bring(Mode.GAIT)


@contextlib.contextmanager
def plain_client(service, program, *arguments):
    """A process that knows Zenoh and nothing of ours, after its first line."""
    endpoint = f"tcp/127.0.0.1:{service.zenoh_port}"
    command = [sys.executable, "-I", "-c", program, endpoint, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            process.stdout.readline()
            yield process
        finally:
            process.kill()


@contextlib.contextmanager
def session_with(service):
    config = zenoh.Config()
    settings = client_settings(Target((f"tcp/127.0.0.1:{service.zenoh_port}",), "trainer"))
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    try:
        yield session
    finally:
        session.close()


def hears(service, session, count=SAMPLES):
    """Until so many samples of the activity have come."""
    came = []
    with session.declare_subscriber("gaitd/trainer/right/activity", came.append):
        service.wait(lambda: len(came) >= count, TIMEOUT_S)


def answers(service):
    """Whether it answers in time; a single client gives up after 3 s of the computer's time."""

    def asked():
        return service.request("status").get("safety", {}).get("valid", False)

    service.wait(asked, TIMEOUT_S)
    return True


def undisturbed(service, disturb):
    """Do something beside the walking core; its result."""
    with Watch(service.bring(Mode.GAIT)) as seen:
        before = service.newest()
        result = disturb(service)
        records = seen.records_since()
    causes = {record.verdict.cause for record in records}
    assert causes == {Cause.NONE}
    assert {record.mode for record in records} == {Mode.GAIT}
    assert {record.stop_count for record in records} == {before.stop_count}
    assert {record.request.id for record in records} == {before.request.id}
    assert records[-1].tx_dropped_count == before.tx_dropped_count
    return result


def told(fault_table, fault, what, noticed="none"):
    fault_table.add(fault, "walking", noticed, what, None, "none", "gait")


def hang(service):
    with plain_client(service, DEAF) as client, session_with(service) as session:
        client.send_signal(signal.SIGSTOP)
        hears(service, session, 2 * SAMPLES)
        client.send_signal(signal.SIGCONT)
        hears(service, session, SAMPLES // 2)
    return answers(service)


def test_a_subscriber_that_never_reads_takes_nothing_from_the_others(long_service, fault_table):
    answered = undisturbed(long_service, hang)

    assert answered
    told(fault_table, "subscriber that never reads", "others go on hearing")


def come_and_go(service):
    folder = Path(f"/proc/{service.parts['gateway'].pid}/fd")
    with session_with(service) as session:
        hears(service, session, 1)
    before = len(list(folder.iterdir()))
    for _ in range(COMING_AND_GOING):
        with session_with(service) as session:
            hears(service, session, 1)
            assert list(session.get("gaitd/trainer/control/status"))
    service.wait(lambda: len(list(folder.iterdir())) <= before, TIMEOUT_S)
    return answers(service)


def test_clients_that_come_and_go_leave_nothing_open_in_the_gateway(long_service, fault_table):
    answered = undisturbed(long_service, come_and_go)

    assert answered
    told(fault_table, "clients that come and go", "no descriptor stays open")


def cut(pid: int, port: int, state: str) -> int:
    """Shut down a process' TCP sockets on a local port, as a lost network does; how many.

    Raises:
        OSError: this needs ptrace rights, and a kernel that knows pidfd_getfd.
    """
    inodes = _inodes(pid, port, state)
    pidfd = os.pidfd_open(pid)
    try:
        return sum(_shut_down(pidfd, number) for number in _numbers(pid, inodes))
    finally:
        os.close(pidfd)


def _inodes(pid: int, port: int, state: str) -> set[str]:
    lines = Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]
    rows = [line.split() for line in lines]
    return {row[9] for row in rows if row[1].endswith(f":{port:04X}") and row[3] == state}


def _numbers(pid: int, inodes: set[str]) -> list[int]:
    found = []
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            target = str(link.readlink())
            if target.startswith("socket:[") and target[8:-1] in inodes:
                found.append(int(link.name))
    return found


def _shut_down(pidfd: int, number: int) -> bool:
    libc = ctypes.CDLL(None, use_errno=True)
    ours = libc.syscall(PIDFD_GETFD, pidfd, number, 0)
    if ours < 0:
        raise OSError(ctypes.get_errno(), "pidfd_getfd")
    with socket.socket(fileno=ours) as end:
        end.shutdown(socket.SHUT_RDWR)
    return True


def cut_all(service):
    pid = service.parts["gateway"].pid
    with session_with(service) as session:
        hears(service, session, 1)
        try:
            count = cut(pid, service.zenoh_port, ESTABLISHED)
        except OSError as error:
            pytest.skip(f"no socket of another process may be cut here: {error}")
        hears(service, session)  # connected again by itself
    return count


def test_a_session_that_is_cut_is_not_noticed_by_the_core_and_comes_back(long_service, fault_table):
    count = undisturbed(long_service, cut_all)

    assert count > 0
    told(fault_table, "Zenoh sessions cut", "clients connect again", "the clients")


def cut_listener(service):
    with session_with(service) as session:
        hears(service, session, 1)
        try:
            count = cut(service.parts["gateway"].pid, service.zenoh_port, LISTENING)
        except OSError as error:
            pytest.skip(f"no socket of another process may be cut here: {error}")
        hears(service, session)
        asked = list(session.get("gaitd/trainer/control/status"))
    stranger = service.request("status")
    service.kill("gateway")  # only another one listens again
    return count, asked, stranger


@pytest.mark.thorough
def test_a_listener_that_is_lost_keeps_new_clients_out_until_the_gateway_starts_again(
    long_service, fault_table
):
    count, asked, stranger = undisturbed(long_service, cut_listener)

    assert count == 1
    assert asked
    assert stranger["outcome"] == "unanswered"
    long_service.bring(Mode.HOLD)
    what = "sessions that exist go on, new clients get no answer: start the gateway again"
    told(fault_table, "Zenoh listener lost", what, "new clients")


def run_out_of_descriptors(service):
    pid = service.parts["gateway"].pid
    limits = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    used = sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (used + 2, limits[1]))
    opened, refused = contextlib.ExitStack(), 0
    with opened:
        for _ in range(HANDFUL):
            try:
                opened.enter_context(session_with(service))
            except zenoh.ZError:
                refused += 1
    resource.prlimit(pid, resource.RLIMIT_NOFILE, limits)
    assert answers(service)
    return refused


@pytest.mark.thorough
def test_a_gateway_without_descriptors_refuses_clients_and_serves_again_when_there_are_some(
    long_service, fault_table
):
    refused = undisturbed(long_service, run_out_of_descriptors)

    assert refused > 0
    told(fault_table, "gateway out of file descriptors", "refused, served later", "new clients")


def await_rest(service):
    """Wait until the leg rests: without power it sinks into its springs, and swings there."""
    rest_cycles = 0

    def rests(record):
        nonlocal rest_cycles
        speeds = speeds_by_leg(record)
        is_slow = all(hip < STANDSTILL[0] and slide < STANDSTILL[1] for hip, slide in speeds)
        rest_cycles = rest_cycles + 1 if is_slow else 0
        return rest_cycles >= REST_CYCLES

    service.until(rests, TIMEOUT_S)


def test_a_client_killed_while_its_request_is_answered_leaves_the_request_and_the_gateway(
    long_service, fault_table
):
    service = long_service.bring(Mode.READY)
    pid = service.parts["gateway"].pid
    await_rest(service)
    with plain_client(service, ASKS_AND_WAITS, "enable", "{}") as client:
        service.until(lambda record: record.mode == Mode.HOLD, TIMEOUT_S)
        client.kill()
        client.wait()
    first = service.newest().seq
    record = service.until(lambda record: record.seq > first + SAMPLES)

    assert record.mode == Mode.HOLD
    assert service.parts["gateway"].pid == pid
    assert answers(service)
    fault_table.add(
        "client SIGKILL while enable is answered",
        "ready",
        "none",
        "the request is carried out",
        None,
        "none",
        "hold",
    )


def test_a_port_that_is_in_use_is_a_configuration_error_that_names_it_and_disturbs_nothing(
    walking, tmp_path_factory, fault_table
):
    stranger = Service(tmp_path_factory.mktemp("stranger"))
    text = stranger.config.read_text()
    stranger.config.write_text(text.replace(str(stranger.zenoh_port), str(walking.zenoh_port)))
    with Watch(walking) as seen:
        code, said = stranger.ran("gateway")
        records = seen.records_since()

    assert code == CONFIGURATION_ERROR
    assert f"tcp/127.0.0.1:{walking.zenoh_port}" in said
    assert "Traceback" not in said
    assert {record.verdict.cause for record in records} == {Cause.NONE}
    fault_table.add(
        "Zenoh port in use", "start", "gateway", "exit 2, names it", None, "said", "ended"
    )
