"""The real core under what looks like systemd to it: a notify socket, SIGHUP, and its threads.

Only states and messages are looked at, no times.
"""

import os
import signal
import socket
import tempfile
import threading
from pathlib import Path

import pytest
from gaitd_names import Cause, Mode
from long_service import TIMEOUT_S, LongService

from drives.signals import PowerState
from gaitd_lab.processes import memory_folder

pytestmark = pytest.mark.realtime

BEATS = 50


class Supervisor:
    """NOTIFY_SOCKET: keeps every datagram, and who sent it."""

    def __init__(self, path):
        self.path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind(str(path))
        self.lines, self.pids = [], set()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        while True:
            data, ancillary, _, _ = self._socket.recvmsg(4096, socket.CMSG_SPACE(12))
            self.pids |= {int.from_bytes(raw[:4], "little") for _, _, raw in ancillary}
            self.lines += data.decode().split("\n")

    def said(self):
        """All lines so far."""
        return list(self.lines)

    def status(self):
        return [line for line in self.said() if line.startswith("STATUS=")][-1]

    def beats(self):
        return self.said().count("WATCHDOG=1")


class Supervised(LongService):
    """Virtual drives and a gateway, and a core with a supervisor."""

    def __init__(self, folder):
        super().__init__(folder, wall_clock=True)
        self.systemd = Supervisor(folder / "notify")

    def begin(self):
        self.start_drives()
        systemd = {"NOTIFY_SOCKET": str(self.systemd.path), "WATCHDOG_USEC": "1000000"}
        self.start("core", "--admit-simulated", environment=systemd)
        self.start("gateway")
        self.wait(lambda: "READY=1" in self.systemd.said(), TIMEOUT_S)
        return self

    @property
    def pid(self):
        return self.parts["core"].pid

    def beats_more(self, count=BEATS):
        before = self.systemd.beats()
        self.wait(lambda: self.systemd.beats() >= before + count, TIMEOUT_S)


@pytest.fixture(scope="module")
def service():
    with tempfile.TemporaryDirectory(dir=memory_folder()) as folder:
        running = Supervised(Path(folder))
        try:
            yield running.begin()
        finally:
            running.end()


def test_ready_is_said_by_the_core_itself_once_and_records_are_there(service):
    seen = service.until(lambda record: record.seq > 0)

    assert not seen.time_is_simulated
    assert service.systemd.said().count("READY=1") == 1
    assert service.systemd.pids == {service.pid}


def test_a_silent_drive_leaves_the_same_process_fed_the_other_axis_held_the_cause_in_the_status(
    service,
):
    service.bring(Mode.HOLD)
    pid = service.pid
    service.inject("silent right/hip 600")
    try:
        service.until(lambda record: record.mode == Mode.FAULT)
        service.beats_more()
        newest, status = service.newest(), service.systemd.status()
    finally:
        service.inject("clear silent right/hip")

    assert service.pid == pid
    assert service.runs("core")
    assert newest.verdict.cause in {Cause.DRIVE_SILENT, Cause.HEARTBEAT_LOST}
    assert newest.drives[1].power_state == PowerState.QUICK_STOP_ACTIVE
    assert status.startswith("STATUS=Stopped: right, hip: ")
    assert status.endswith(f"[fault {newest.verdict.cause} right/hip]")


def test_a_hang_up_ends_neither_process_and_is_answered_by_both(service):
    for part in ("core", "gateway"):
        service.kill(part, signal.SIGHUP)

    def has(key, words):
        return any(
            (one[key] or "").startswith(words) for one in service.request("status")["events"]
        )

    service.wait(lambda: has("code", "reload_refused"), TIMEOUT_S)
    service.wait(lambda: has("text", "reloaded: "), TIMEOUT_S)
    assert service.runs("core")
    assert service.runs("gateway")


def test_the_core_is_one_thread_with_libraries_and_all_and_it_has_the_real_time_class(service):
    tasks = [int(task.name) for task in Path(f"/proc/{service.pid}/task").iterdir()]

    assert tasks == [service.pid]
    if "SCHED_FIFO priority" not in service.log("core"):  # refused, and said so
        assert os.sched_getscheduler(service.pid) == os.SCHED_FIFO | os.SCHED_RESET_ON_FORK


def test_sigterm_says_stopping_and_at_the_end_what_remains(service):
    service.bring(Mode.READY)

    service.kill("core", signal.SIGTERM)
    assert service.parts["core"].wait(TIMEOUT_S) == 0

    service.wait(lambda: service.systemd.status().startswith("STATUS=ended"), TIMEOUT_S)
    lines = service.systemd.said()
    assert lines.count("STOPPING=1") == 1
    assert lines[-1].startswith("STATUS=ended: all axes are at rest and without power")
