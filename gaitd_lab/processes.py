"""Child processes that end with this process; virtual drives, core and gateway among them.

`ManagedProcess` is one process with its output in a file. `ServiceProcesses` is the virtual drives
and the service of one configuration: the test plugin (`gaitd_lab.testing`), the demonstration
and the benchmarks are built on it. `gaitd run` is not: it supervises the service of a real machine.
"""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from gaitd_client.connection import Target

from daemon.config.edits import Edits, edit
from daemon.config.shipped import configs_folder
from daemon.ipc.transport import RING_NAME
from sim_drives.control import send_command

SHARED_MEMORY: Final = "/dev/shm"
SIMULATED: Final = "simulated"
"""Interface name of the bus of simulated time."""
GAITD: Final = ("-m", "gaitd")
END_ORDER: Final = ("run", "core", "gateway", "sim")
"""The core stops the axes before it ends, so the virtual drives end last."""
END_S: Final = 15.0
"""Longer than the core needs to stop both axes and to switch off power."""
TAIL_LINES: Final = 40
_END_WITH_PARENT: Final = (
    "import ctypes, os, sys; ctypes.CDLL(None).prctl(1, 9); "
    "os.getppid() == int(sys.argv[1]) and os.execv(sys.argv[2], sys.argv[2:])"
)
"""Requests SIGKILL from the kernel for the end of the parent (PR_SET_PDEATHSIG), because a stopped
process obeys nothing else, and then executes the given command, unless the parent has already
ended. A function between fork and exec would do the same, but is not safe beside threads.
"""


class ServiceError(AssertionError):
    """The service, or one of its processes, does not do what it must; a failure of a test."""

    folder: Path | None = None
    """Folder of logs, truth and black box, if it was kept."""


@dataclass(frozen=True, slots=True)
class Tempo:
    """Pace of time on a simulated bus."""

    pace: str = "1"
    """Pace of simulated time, as in `gaitd sim --pace`."""
    wall_clock: bool = False
    """True to use the computer's time instead."""


class ManagedProcess(subprocess.Popen[bytes]):
    """A process `python WORDS...` with its output in a file; it is killed if this process dies."""

    def __init__(
        self,
        name: str,
        words: Sequence[str],
        log: Path,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Start it in a session that receives no Ctrl-C, and in the folder of its log.

        Args:
            name: name in messages.
            words: arguments of Python.
            log: the file that its output is appended to.
            environment: additional environment variables.
        """
        self.name, self._log = name, log
        with log.open("ab") as output:
            self._begin = output.tell()
            super().__init__(
                tied(*words),
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=output,
                cwd=log.parent,
                env={**os.environ, **(environment or {})},
                start_new_session=True,
            )

    def output(self) -> str:
        """Return its output on stdout and stderr."""
        return self._log.read_bytes()[self._begin :].decode("utf-8", errors="replace")

    def last_output(self) -> str:
        """Return the end of its output."""
        return "\n".join(self.output().splitlines()[-TAIL_LINES:]) or "(nothing)"

    def check(self) -> None:
        """Check that it is alive.

        Raises:
            ServiceError: it is not; with its last output.
        """
        if self.poll() is not None:
            words = f"{self.name} ended with {self.returncode}; its last output:"
            raise ServiceError(f"{words}\n{self.last_output()}")

    def end(self) -> int:
        """End it in any state, by SIGTERM, and after END_S by SIGKILL; return its exit code."""
        if self.poll() is None:
            self.send_signal(signal.SIGCONT)
            self.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.wait(END_S)
            self.kill()
        if self.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self.stdin.close()
        return self.wait()


class ServiceProcesses:
    """Virtual drives and service of one configuration, with ports and folders of their own."""

    def __init__(
        self,
        folder: Path,
        configs: Path | None = None,
        *,
        trainer_file: str = "demo.toml",
        edits: Edits | None = None,
        tempo: Tempo | None = None,
    ) -> None:
        """Write the configuration; no process is started.

        Args:
            folder: folder of these processes alone; all their files go there.
            configs: a folder of configurations, copied; None: those that come with gaitd.
            trainer_file: name of the trainer file in that folder.
            edits: keys with other values, by file; they override the ports and paths set here.
            tempo: pace of time; None: that of the computer.

        Raises:
            EditError: a key that does not exist.
        """
        self.folder = folder
        self.tempo = tempo or Tempo()
        self.zenoh_port = free_port()
        configs = configs or configs_folder("configs", trainer_file)
        own = shutil.copytree(configs, folder / "configuration")
        self.config = own / trainer_file
        edit(own, {trainer_file: self._own_places()})
        edit(own, edits or {})
        self.table: dict[str, Any] = tomllib.loads(self.config.read_text(encoding="utf-8"))
        """The trainer file."""
        bus = self.table["bus"]
        self.channel = Path(bus["channel"])
        self.is_on_simulated_bus: bool = bus["interface"] == SIMULATED
        self.target = Target((self.table["zenoh"]["listen"][0],), self.table["zenoh"]["trainer"])
        """Address of the service for Zenoh clients."""
        self.legs: tuple[str, ...] = tuple(leg["name"] for leg in self.table["leg"])
        self.leg = self.legs[0]
        self.ring_path = self.config.parent / self.table["paths"]["runtime"] / RING_NAME
        self.truth_path = folder / "truth.csv"
        """CSV file of the plant's true state; with several legs as `truth_path` names it."""
        self.control_path = folder / "control"
        """Command socket of the virtual drives."""
        self.parts: dict[str, ManagedProcess] = {}

    def _own_places(self) -> dict[str, str | Sequence[str]]:
        return {
            "bus.interface": SIMULATED,
            "bus.channel": str(self.folder / "bus"),
            "zenoh.listen": [f"tcp/127.0.0.1:{self.zenoh_port}"],
            "paths.runtime": str(self.folder / "run"),
            "paths.state": str(self.folder / "state"),
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def time_arguments(self) -> tuple[str, ...]:
        """Arguments of `gaitd sim` for the pace of time."""
        if self.tempo.wall_clock:
            return ("--wall-clock",)
        return ("--pace", self.tempo.pace) if self.is_on_simulated_bus else ()

    @property
    def output_arguments(self) -> tuple[str, ...]:
        """Arguments of `gaitd sim` for the truth and the command socket."""
        return ("--truth", str(self.truth_path), "--control", str(self.control_path))

    def start(
        self,
        part: str,
        *arguments: str,
        program: Sequence[str] = GAITD,
        environment: Mapping[str, str] | None = None,
    ) -> ManagedProcess:
        """Start one part.

        Args:
            part: `sim`, `core`, `gateway`, or `run` for both.
            arguments: arguments besides `--config`.
            program: program that runs `gaitd PART`, if it is not `gaitd` itself.
            environment: additional environment variables.
        """
        words = (*program, part, "--config", str(self.config), *arguments)
        log = self.folder / f"{part}.log"
        self.parts[part] = ManagedProcess(f"gaitd {part}", words, log, environment)
        return self.parts[part]

    def kill(self, part: str, number: int = signal.SIGKILL) -> None:
        """Send a part a signal; for SIGKILL, wait until it has ended."""
        self.parts[part].send_signal(number)
        if number == signal.SIGKILL:
            self.parts[part].wait()

    def check(self) -> None:
        """Check that all started parts are alive.

        Raises:
            ServiceError: one has ended; with its last output.
        """
        for process in self.parts.values():
            process.check()

    def end(self) -> None:
        """End all running parts, in any state."""
        for part in END_ORDER:
            if part in self.parts:
                self.parts[part].end()

    def inject(self, line: str) -> str:
        """Send the virtual drives a command, e.g. `silent right/hip 0.5`; return the answer.

        Raises:
            ServiceError: they do not answer.
        """
        try:
            return send_command(self.control_path, line)
        except OSError as error:
            raise ServiceError(f"the virtual drives do not answer: {error}") from error


def tied(*words: str) -> list[str]:
    """Return the command `python WORDS...` that is killed when this process has ended."""
    python = sys.executable
    return [python, "-c", _END_WITH_PARENT, str(os.getpid()), python, *words]


def free_port() -> int:
    """Return a port of the loopback interface that is not in use."""
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        return holder.getsockname()[1]


def memory_folder() -> str | None:
    """Return a folder in memory if there is one: a disk's write-back stalls its writers.

    Measured: 110 ms without an answer, half a minute after the truth was first written to a disk.
    """
    return SHARED_MEMORY if os.access(SHARED_MEMORY, os.W_OK | os.X_OK) else None
