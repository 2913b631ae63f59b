"""The environment of an act: its folder, virtual drives and service as processes, its time.

An act runs in simulated time, in which the demonstration has a seat like the core: time passes
only while it waits. With `--wall-clock` time is the computer's.

No process outlives an act. The processes get SIGTERM in their order, SIGKILL after their time
limit, and SIGTERM from the kernel if the demonstration itself is killed.
"""

import contextlib
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import tomllib
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from daemon.config.robot import leg_parameters
from daemon.config.settings import Robot
from daemon.system.clock import PageClock
from gaitd.remote import Target
from gaitd_lab.demonstration.script import READY_WITHIN_S, ActError
from gaitd_lab.processes import free_ports, memory_folder, tied
from observer.mechanism.mechanism import gravity
from sim_drives.time.server import process_state
from simtime.link import LinkLostError, SocketLink
from simtime.page import PageWriter, page_path
from simtime.wire import Role

SERVICE_END_S: Final = 15.0
"""The service stops both axes before it ends."""
DRIVES_END_S: Final = 5.0
TAIL_LINES: Final = 12
BUS: Final = "bus"
"""Name of the bus's socket, in the folder of an act."""
TURN_S: Final = 0.1
HAND_NAME, SEAT_NAME, CORE_SEAT = "demo", "demo", "core"
OBEYED_WITHIN_S: Final = 10.0
ANSWER_SIZE_MAX: Final = 4096
STOPPED: Final = "T"
"""State of a process that was stopped by a signal, as in proc(5)."""


@dataclass(frozen=True, slots=True)
class Tempo:
    """Pace of the acts' time."""

    pace: str = "1"
    """Pace of simulated time, as in `gaitd sim --pace`."""
    wall_clock: bool = False
    """True to use the computer's time instead."""

    @property
    def arguments(self) -> list[str]:
        """Return the arguments for `gaitd sim`."""
        return ["--wall-clock"] if self.wall_clock else ["--pace", self.pace]


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

    def turn(self, *, gateway_is_there: bool) -> None:
        """Let a turn pass: by the computer's time until the act begins, then in the act's.

        Raises:
            ActError: core and gateway have not come in time.
        """
        try:
            if self._has_begun or (gateway_is_there and self._core_is_there()):
                self._pass()
                return
        except LinkLostError:
            pass  # the ended process is detected by its exit code
        if not self._has_begun and time.monotonic() - self._made_wall_s > READY_WITHIN_S:
            raise ActError(f"core and gateway are not there within {READY_WITHIN_S:g} s")
        time.sleep(TURN_S)

    def close(self) -> None:
        """Give up the seat."""
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


@dataclass(frozen=True, slots=True)
class Stage:
    """Files, processes and time of one act."""

    folder: Path
    config: Path
    truth: Path
    control: Path
    """Command socket of the virtual drives, for faults and the patient."""
    target: Target
    leg: str
    time: StageTime
    drives: "ManagedProcess"
    service: "ManagedProcess"

    def patient(self, programme: str) -> None:
        """Start one of the patient's programmes; it runs when this returns.

        Raises:
            ActError: the virtual drives do not answer.
        """
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            own = self.folder / "demo.sock"
            try:
                sender.bind(str(own))
                sender.settimeout(OBEYED_WITHIN_S)
                sender.sendto(f"patient {programme}".encode(), str(self.control))
                sender.recv(ANSWER_SIZE_MAX)
            except OSError as error:
                raise ActError(f"the virtual drives do not answer: {error}") from error
            finally:
                own.unlink(missing_ok=True)

    def check(self) -> None:
        """Check that both processes are alive.

        Raises:
            ActError: one has ended; with its last output.
        """
        for troupe in (self.drives, self.service):
            troupe.check()

    def stopped(self) -> list[str]:
        """Return the processes of the act that a signal has stopped, as text."""
        return [
            f"{name} (pid {pid}) is stopped by a signal"
            for troupe in (self.drives, self.service)
            for pid, name in troupe.family()
            if process_state(pid) == STOPPED
        ]


class ManagedProcess:
    """One process with its output in a file."""

    def __init__(
        self,
        name: str,
        arguments: list[str],
        log: Path,
        program: tuple[str, ...] = ("-m", "gaitd"),
    ) -> None:
        """Start `python PROGRAM ARGUMENTS` in a session that receives no Ctrl-C."""
        self._name = name
        self._log = log
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                tied(*program, *arguments),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def check(self) -> None:
        """Check that the process is alive.

        Raises:
            ActError: it is not.
        """
        code = self._process.poll()
        if code is not None:
            raise ActError(f"{self._name} ended with {code}; its last words:\n{self.last_words()}")

    def exit_code(self) -> int | None:
        """Exit code; None while it is alive."""
        return self._process.poll()

    def signal(self, number: int) -> None:
        """Send a signal; does nothing after the process has ended."""
        self._process.send_signal(number)

    def family(self) -> list[tuple[int, str]]:
        """Return the process and its children, by process id, with what they run."""
        pids = [self.pid]
        for task in Path(f"/proc/{self.pid}/task").glob("*/children"):
            with contextlib.suppress(OSError):
                pids += map(int, task.read_text(encoding="ascii").split())
        return [(pid, f"gaitd {_part_of(pid)}") for pid in pids]

    def last_words(self) -> str:
        """Return the end of its output."""
        lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-TAIL_LINES:]) or "    (nothing)"

    def end(self, patience_s: float) -> int:
        """End the process and return its exit code."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
            try:
                self._process.wait(patience_s)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        return self._process.returncode


def _part_of(pid: int) -> str:
    """Return the part of gaitd that a process runs."""
    with contextlib.suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8").split("\0")
        if "--config" in words:
            return words[words.index("--config") - 1]
    return "process"


@contextlib.contextmanager
def stage(
    configs: Path, *, empty: bool, tempo: Tempo | None = None, begin_ns: int = 0
) -> Generator[Stage]:
    """Start all of one act; it is ended in every case.

    Args:
        configs: the project's folder of configurations.
        empty: the trainer is empty, and its springs carry it alone.
        tempo: pace of its time; None: the computer's.
        begin_ns: its time begins no earlier.
    """
    folder = Path(tempfile.mkdtemp(prefix="gaitd-demo-", dir=memory_folder()))
    with contextlib.ExitStack() as ending:
        ending.push(_tidy(folder))
        config, endpoint = write_configs(configs, folder / "configs", empty=empty)
        truth, control = folder / "truth.csv", folder / "sim.sock"
        places = ["--config", str(config), "--truth", str(truth), "--control", str(control)]
        tempo = tempo or Tempo()
        passing = StageTime(folder / BUS, begin_ns, tempo)
        ending.callback(passing.close)
        held = [] if tempo.wall_clock else ["--hold"]
        arguments = ["sim", *places, *tempo.arguments, *held]
        drives = ManagedProcess("gaitd sim", arguments, folder / "sim.log")
        ending.callback(drives.end, DRIVES_END_S)
        service = ManagedProcess("gaitd run", ["run", "--config", str(config)], folder / "run.log")
        ending.callback(service.end, SERVICE_END_S)
        table = tomllib.loads(config.read_text(encoding="utf-8"))
        target = Target((endpoint,), table["zenoh"]["trainer"])
        leg = table["leg"][0]["name"]
        yield Stage(folder, config, truth, control, target, leg, passing, drives, service)


def _tidy(folder: Path) -> Callable[..., bool]:
    """Remove the folder of a successful act; after an error it is kept, and the error names it."""

    def leave(_kind: type[BaseException] | None, error: BaseException | None, _: object) -> bool:
        if isinstance(error, ActError):
            error.folder = folder
        else:
            shutil.rmtree(folder, ignore_errors=True)
        return False

    return leave


def write_configs(configs: Path, folder: Path, *, empty: bool) -> tuple[Path, str]:
    """Copy the configurations, with free ports and paths of this act.

    Args:
        configs: the project's folder of configurations.
        folder: destination of the copy.
        empty: the trainer is empty.

    Returns: the trainer file, and the Zenoh endpoint of the service.
    """
    shutil.copytree(configs, folder)
    (zenoh_port,) = free_ports(1)
    endpoint = f"tcp/127.0.0.1:{zenoh_port}"
    trainer, plant = folder / "demo.toml", folder / "plant.toml"
    values = {
        "channel": f'"../{BUS}"',
        "listen": f'["{endpoint}"]',
        "runtime": '"../run"',
        "state": '"../state"',
    }
    if empty:
        balance(folder / "robot_empty.toml", plant)
        values["robot"] = '"robot_empty.toml"'
        rewrite(plant, {"robot": '"robot_empty.toml"'})
    rewrite(trainer, values)
    return trainer, endpoint


def balance(robot_file: Path, plant_file: Path) -> None:
    """Adjust the springs to carry the machine in the start pose of the virtual drives.

    Springs set for a patient push the empty machine up to its stop, as its file states; an
    operator reduces them before an experiment on it.
    """
    text = robot_file.read_text(encoding="utf-8")
    robot = msgspec.toml.decode(text, type=Robot)
    start = tomllib.loads(plant_file.read_text(encoding="utf-8"))["start"]
    pose = np.array((np.radians(start["hip_deg"]), start["slide_m"]))
    load = gravity(leg_parameters(robot), pose)
    springs = robot.springs
    hip_rest_rad = springs.hip_rest_rad + load[0] / springs.hip_stiffness_nm_per_rad
    slide_rest_m = springs.slide_rest_m + load[1] / springs.slide_stiffness_n_per_m
    rewrite(
        robot_file,
        {"hip_rest_rad": f"{hip_rest_rad:.6f}", "slide_rest_m": f"{slide_rest_m:.6f}"},
    )


def rewrite(file: Path, values: dict[str, str]) -> None:
    """Set the values of keys that occur once in a TOML file; comments stay."""
    text = file.read_text(encoding="utf-8")
    for key, value in values.items():
        text, count = re.subn(
            rf"^{key}(\s*)=[^#\n]*", lambda _, k=key, v=value: f"{k} = {v}  ", text, flags=re.M
        )
        if count != 1:
            raise ValueError(f"{file.name} has {count} lines with the key {key}, 1 was expected")
    file.write_text(text, encoding="utf-8")
