"""The environment of an act: its folder, virtual drives and service as processes, its time.

An act runs in simulated time, in which the demonstration has a seat like the core: time passes
only while it waits. With `--wall-clock` time is the computer's. The service is `gaitd run`.
"""

import contextlib
import math
import shutil
import tempfile
import time
import tomllib
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Final

import msgspec
from gaitd_client import read_credentials

from daemon.config.edits import Edits
from daemon.config.settings import Robot
from daemon.keys import issuing
from daemon.keys.folder import ISSUED
from gaitd_lab.demonstration.script import READY_WITHIN_S
from gaitd_lab.processes import ServiceError, ServiceProcesses, Tempo, memory_folder
from gaitd_lab.trials import balanced
from simtime.clock import PageClock
from simtime.link import LinkLostError, SocketLink
from simtime.page import PageWriter, page_path
from simtime.processes import STOPPED, process_state
from simtime.wire import Role

TURN_S: Final = 0.1
HAND_NAME, SEAT_NAME, CORE_SEAT = "demo", "demo", "core"
KEYS_DAYS: Final = 1
CLIENTS: Final = {
    "demo": "display.demo",
    "engineer": "display.engineer",
    "patient": "session.patient",
    "therapist": "operator.therapist",
}
"""Clients of a training, and their roles."""
TRAINING_EDITS: Final[Edits] = {
    "demo.toml": {"self_test.required": "daily", "gait.announce_s": 0.5, "gait.ramp_strides": 1}
}
"""The daily test as on a real trainer; a session of a minute has no time for long beginnings."""


class StageTime:
    """The time of an act.

    Simulated time is held until core and gateway are connected, so that an act begins at the same
    instant for both on each run; then the demonstration takes a seat in step.
    """

    def __init__(self, channel: Path, begin_ns: int, tempo: Tempo) -> None:
        """Begin no earlier than the end of the previous act.

        Args:
            channel: socket of the act's simulated bus.
            begin_ns: end of the previous act.
            tempo: pace of the time.
        """
        page = PageWriter(page_path(channel))
        page.begin(max(begin_ns, page.left_ns), time.time_ns() - begin_ns, wall_clock=False)
        page.leave()
        self._is_wall_clock = tempo.wall_clock
        self._page = PageClock(channel)
        self._hand = SocketLink(channel, Role.HAND, HAND_NAME)
        self._link = SocketLink(channel, Role.IN_STEP, SEAT_NAME)
        self._threads = ThreadPoolExecutor(1, "time")
        self._has_begun = False
        self._made_wall_s = time.monotonic()
        self.began_ns = 0
        """Time at which core and gateway were connected."""
        self._began_wall_s = 0.0

    def now_ns(self) -> int:
        """Monotonic time of the core."""
        return self._page.now_ns()

    def of_utc_ns(self, utc_ns: int) -> int:
        """Return the monotonic time of an instant of the core's UTC."""
        return utc_ns - self._page.utc_ahead_ns()

    @property
    def speed_ratio(self) -> float | None:
        """Ratio of the act's time to the computer's; None before the act begins."""
        wall_s = time.monotonic() - self._began_wall_s
        if not self._has_begun or wall_s < 1:
            return None
        return (self.now_ns() - self.began_ns) * 1e-9 / wall_s

    def turn(self, meanwhile: Callable[[], None], *, gateway_is_there: bool) -> None:
        """Let a turn pass: by the computer's time until the act begins, then in the act's.

        Args:
            meanwhile: is called while it passes: a live view takes as long to draw as half a turn.
            gateway_is_there: the gateway is connected.

        Raises:
            ServiceError: core and gateway have not come in time.
        """
        passing = self._threads.submit(self._turn, gateway_is_there=gateway_is_there)
        meanwhile()
        passing.result()

    def _turn(self, *, gateway_is_there: bool) -> None:
        try:
            if self._has_begun or (gateway_is_there and self._core_is_there()):
                self._pass()
                return
        except LinkLostError:
            pass  # the ended process is detected by its exit code
        if not self._has_begun and time.monotonic() - self._made_wall_s > READY_WITHIN_S:
            raise ServiceError(f"core and gateway are not there within {READY_WITHIN_S:g} s")
        time.sleep(TURN_S)

    def close(self) -> None:
        """Give up the seat; a turn that still passes ends with it, or with the virtual drives."""
        self._threads.shutdown(wait=False)
        self._link.close()
        self._hand.close()

    def _core_is_there(self) -> bool:
        if self._is_wall_clock:
            return True
        self._hand.open()
        return CORE_SEAT in self._hand.command("seats").split()

    def _pass(self) -> None:
        self._link.open()
        if not self._has_begun:
            if not self._is_wall_clock:
                self._hand.command("go")
                self._hand.close()
            self._has_begun = True
            self.began_ns, self._began_wall_s = self._link.now_ns(), time.monotonic()
        self._link.wait(self._link.now_ns() + round(TURN_S * 1e9), for_frame=False)
        self._link.take()


class Setting(Enum):
    """What the configuration of an act is like."""

    PATIENT = "a patient in the machine"
    EMPTY = "the empty machine, which its springs carry alone"
    TRAINING = "a patient who is alone: the service has keys, and requires the daily test"


class Stage(ServiceProcesses):
    """Files, processes and time of one act."""

    def __init__(
        self, folder: Path, configs: Path, setting: Setting, *, tempo: Tempo, begin_ns: int
    ) -> None:
        """Write the configuration of the act; see `stage`."""
        super().__init__(folder, configs, edits=_edits(configs, setting), tempo=tempo)
        self.credentials: dict[str, Path] = {}
        """Folders of the clients' credentials; empty: the service has no keys."""
        if setting is Setting.TRAINING:
            self._issue_keys()
        self.time = StageTime(self.channel, begin_ns, tempo)

    def _issue_keys(self) -> None:
        """Make the service's keys, and those of its clients, as `gaitd keys` does."""
        text = self.config.read_text(encoding="utf-8")
        self.config.write_text(text.replace("[zenoh]\n", '[zenoh]\nkeys = "keys"\n'), "utf-8")
        keys, now = self.config.parent / "keys", datetime.now(UTC)
        issuing.init(keys, self.target.trainer, [], now, KEYS_DAYS)
        for role in CLIENTS.values():
            endpoints = self.target.endpoints
            issuing.issue(keys, role, endpoints, self.target.trainer, now, KEYS_DAYS, remote=False)
        self.credentials = {client: keys / ISSUED / role for client, role in CLIENTS.items()}
        own = read_credentials(self.credentials["demo"])
        self.target = self.target._replace(credentials=own)

    def start_all(self) -> None:
        """Start the virtual drives, with time held if it is simulated, and the service."""
        held = () if self.tempo.wall_clock else ("--hold",)
        self.start("sim", *self.output_arguments, *self.time_arguments, *held)
        self.start("run")

    def end(self) -> None:
        """End the processes, then give up the seat."""
        super().end()
        self.time.close()

    def stopped(self) -> list[str]:
        """Return the processes of the act that a signal has stopped, as text."""
        return [
            f"gaitd {_part_of(pid)} (pid {pid}) is stopped by a signal"
            for process in self.parts.values()
            for pid in _family(process.pid)
            if process_state(pid) == STOPPED
        ]


def _family(pid: int) -> list[int]:
    """Return a process and its children."""
    pids = [pid]
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            pids += map(int, task.read_text(encoding="ascii").split())
    return pids


def _part_of(pid: int) -> str:
    """Return the part of gaitd that a process runs."""
    with contextlib.suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8").split("\0")
        if "--config" in words:
            return words[words.index("--config") - 1]
    return "process"


@contextlib.contextmanager
def stage(
    configs: Path, setting: Setting, *, tempo: Tempo | None = None, begin_ns: int = 0
) -> Generator[Stage]:
    """Start all of one act; it is ended in every case.

    The folder of a successful act is removed; after an error it is kept, and the error names it.

    Args:
        configs: the project's folder of configurations.
        setting: what the configuration is like.
        tempo: pace of its time; None: the computer's.
        begin_ns: its time begins no earlier.
    """
    folder = Path(tempfile.mkdtemp(prefix="gaitd-demo-", dir=memory_folder()))
    kept = False
    try:
        with Stage(folder, configs, setting, tempo=tempo or Tempo(), begin_ns=begin_ns) as made:
            made.start_all()
            yield made
    except ServiceError as error:
        error.folder, kept = folder, True
        raise
    finally:
        if not kept:
            shutil.rmtree(folder, ignore_errors=True)


def _edits(configs: Path, setting: Setting) -> Edits:
    if setting is Setting.EMPTY:
        return _empty_edits(configs)
    return TRAINING_EDITS if setting is Setting.TRAINING else {}


def _empty_edits(configs: Path) -> Edits:
    """Return the edits for an empty machine that its springs carry in the start pose.

    Springs set for a patient push the empty machine up to its stop, as its file states; an
    operator reduces them before an experiment on it.
    """
    name = "robot_empty.toml"
    robot = msgspec.toml.decode((configs / name).read_text(encoding="utf-8"), type=Robot)
    start = tomllib.loads((configs / "plant.toml").read_text(encoding="utf-8"))["start"]
    pose = math.radians(start["hip_deg"]), start["slide_m"]
    springs = balanced(robot, pose).springs
    return {
        "demo.toml": {"robot": name},
        "plant.toml": {"robot": name},
        name: {
            "springs.hip_rest_rad": round(springs.hip_rest_rad, 6),
            "springs.slide_rest_m": round(springs.slide_rest_m, 6),
        },
    }
