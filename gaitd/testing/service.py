"""The service and the virtual drives as the processes that people run, and what is seen of them.

Time is simulated, at the pace of the computer's (`simtime`): a computer that stands still makes a
test take longer, and changes nothing of what it sees.

Every part is a process of its own (`gaitd sim`, `gaitd core`, `gaitd gateway`) with its output in
a file. None outlives this process: it is ended by `end`, and killed by the kernel if we are.
"""

import contextlib
import csv
import os
import shutil
import signal
import socket
import subprocess
import time
import tomllib
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Self

import can
import msgspec

from daemon.clock import AgeClock, MonotonicClock, PageClock
from daemon.record import CycleRecord
from daemon.seam import RING_NAME, RingError, RingReader
from gaitd import remote
from gaitd.children import free_ports, tied
from gaitd.places import configs_folder
from gaitd.remote import Target
from gaitd.testing.edits import Edits, edit

SIMULATED, PYTHON_CAN = "simulated", "gaitd"
"""The bus of simulated time, and python-can's name for it."""
POLL_S: Final = 0.02
GAITD: Final = ("-m", "gaitd")
END_S: Final = 10.0
"""The core stops both axes before it ends."""
DRIVES_READY_S: Final = 60.0
LOG_TAIL: Final = 4000


class ServiceError(AssertionError):
    """What was waited for did not come; with the last words of every process."""


class Service:
    """Virtual drives, core and gateway of one configuration, with ports and folders of its own."""

    def __init__(
        self,
        folder: Path,
        configs: Path | None = None,
        *,
        trainer_file: str = "demo.toml",
        edits: Edits | None = None,
    ) -> None:
        """Write the configuration; nothing runs yet.

        Args:
            folder: of this service alone; everything that it writes goes there.
            configs: a folder of configurations, copied; None: those that come with gaitd.
            trainer_file: in that folder.
            edits: keys with other values, by file; they win over ports and paths of our own.

        Raises:
            EditError: a key that is not there.
        """
        self.folder = folder
        (self.zenoh_port,) = free_ports(1)
        configs = configs or configs_folder("configs", trainer_file)
        own = shutil.copytree(configs, folder / "configuration")
        self.config = own / trainer_file
        edit(own, {trainer_file: self._own_places()})
        edit(own, edits or {})
        self._table = tomllib.loads(self.config.read_text(encoding="utf-8"))
        self._clock: AgeClock | None = None
        self.parts: dict[str, subprocess.Popen[bytes]] = {}

    def _own_places(self) -> dict[str, str | Sequence[str]]:
        return {
            "bus.interface": SIMULATED,
            "bus.channel": str(self.folder / "bus"),
            "zenoh.listen": [f"tcp/127.0.0.1:{self.zenoh_port}"],
            "paths.runtime": str(self.folder / "run"),
            "paths.state": str(self.folder / "state"),
        }

    @property
    def clock(self) -> AgeClock:
        """In which its records and its truth count: simulated, or the computer's on a real bus."""
        bus = self._table["bus"]
        if self._clock is None:
            simulated = bus["interface"] == SIMULATED
            self._clock = PageClock(Path(bus["channel"])) if simulated else MonotonicClock()
        return self._clock

    @property
    def endpoint(self) -> str:
        """Where a Zenoh client connects."""
        return self._table["zenoh"]["listen"][0]

    @property
    def trainer(self) -> str:
        """TRAINER of its keys, which begin `gaitd/TRAINER/`."""
        return self._table["zenoh"]["trainer"]

    # --- processes ------------------------------------------------------------------------------

    def start(
        self,
        part: str,
        *arguments: str,
        program: Sequence[str] = GAITD,
        environment: Mapping[str, str] | None = None,
    ) -> subprocess.Popen[bytes]:
        """Start one part.

        Args:
            part: `sim`, `core` or `gateway`.
            arguments: beside `--config`.
            program: what runs `gaitd PART`, where it is not `gaitd` itself.
            environment: what it finds there beside ours.
        """
        words = (*program, part, "--config", str(self.config), *arguments)
        with (self.folder / f"{part}.log").open("ab") as log:
            self.parts[part] = subprocess.Popen(
                # Killed with us, because a part that is stopped obeys nothing else.
                tied(*words, number=signal.SIGKILL),
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                cwd=self.folder,
                env={**os.environ, **(environment or {})},
                start_new_session=True,
            )
        return self.parts[part]

    def start_drives(self) -> None:
        """Start the virtual drives and wait until they are on their bus."""
        log = self.folder / "sim.log"
        said_before = log.stat().st_size if log.exists() else 0
        places = ("--truth", str(self.truth_path), "--control", str(self.control_path))
        drives = self.start("sim", *places, "--truth-in-silence")

        def on_bus() -> bool:
            if drives.poll() is not None:
                raise ServiceError(f"gaitd sim ended with {drives.returncode}\n{self.logs()}")
            return b"virtual drives" in log.read_bytes()[said_before:]

        self.wait(on_bus, DRIVES_READY_S)

    def start_all(self) -> Self:
        """Start every part; what the service does next is waited for by nobody."""
        self.start_drives()
        self.start("core")
        self.start("gateway")
        return self

    def kill(self, part: str, number: int = signal.SIGKILL) -> None:
        """Send a part a signal; SIGKILL is waited for."""
        os.kill(self.parts[part].pid, number)
        if number == signal.SIGKILL:
            self.parts[part].wait()

    def runs(self, part: str) -> bool:
        """Whether the part was started and has not ended."""
        return part in self.parts and self.parts[part].poll() is None

    def end(self) -> None:
        """End what runs, whatever state it is in."""
        for part in reversed(list(self.parts)):
            process = self.parts[part]
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in self.parts.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(END_S)
            if process.poll() is None:
                process.kill()
                process.wait()
            if process.stdin is not None:
                with contextlib.suppress(BrokenPipeError):
                    process.stdin.close()

    def log(self, part: str) -> str:
        """What a part has said on stdout and stderr, of all its runs."""
        return (self.folder / f"{part}.log").read_text(encoding="utf-8", errors="replace")

    def said(self) -> list[tuple[str, str]]:
        """The last words of each part, by its name."""
        return [(part, self.log(part)[-LOG_TAIL:] or "(nothing)") for part in self.parts]

    def logs(self) -> str:
        """The same as one text."""
        return "\n".join(f"--- gaitd {part}\n{words}" for part, words in self.said())

    # --- asking ---------------------------------------------------------------------------------

    def request(self, name: str, **payload: object) -> dict[str, Any]:
        """Query control/NAME: the answer as it came, `unanswered` if there is none."""
        target = Target((self.endpoint,), self.trainer)
        answer = remote.ask(target, name, {"client": "tester", **payload} if payload else {})
        if answer.text is None:
            return {"outcome": "unanswered", "reason": answer.trouble}
        return msgspec.json.decode(answer.text)

    def inject(self, line: str) -> str:
        """Tell the virtual drives, for example `silent right/hip 0.5`; what they answer."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
            own = self.folder / f"tester{time.monotonic_ns()}"
            end.bind(str(own))
            end.settimeout(5)
            try:
                end.sendto(line.encode(), str(self.control_path))
                return end.recv(4096).decode()
            finally:
                own.unlink()

    # --- witnesses ------------------------------------------------------------------------------

    @property
    def truth_path(self) -> Path:
        """CSV of what really happens in the plant."""
        return self.folder / "truth.csv"

    @property
    def control_path(self) -> Path:
        """Socket of the virtual drives."""
        return self.folder / "ctl"

    def wait(self, reached: Callable[[], object], within_s: float, poll_s: float = POLL_S) -> None:
        """Look until it is reached.

        Raises:
            ServiceError: it was not, within the time.
        """
        end_s = time.monotonic() + within_s
        while time.monotonic() < end_s:
            with contextlib.suppress(FileNotFoundError, RingError):
                if reached():
                    return
            time.sleep(poll_s)
        raise ServiceError(f"not reached within {within_s:g} s\n{self.logs()}")

    @contextlib.contextmanager
    def _ring(self) -> Generator[RingReader]:
        with contextlib.closing(
            RingReader(self.config.parent / self._table["paths"]["runtime"] / RING_NAME)
        ) as ring:
            yield ring

    def boot_id(self) -> str:
        """Of the core that wrote the ring; empty where there is none yet."""
        try:
            with self._ring() as ring:
                return ring.header.core_boot_id
        except FileNotFoundError:
            return ""

    def newest(self) -> CycleRecord:
        """The record of the newest cycle.

        Raises:
            FileNotFoundError, RingError: there is none yet.
        """
        with self._ring() as ring:
            record = ring.read(ring.newest_seq())
        if record is None:
            raise FileNotFoundError("no record yet")
        return record

    def records(self, after_seq: int = 0) -> list[CycleRecord]:
        """Records of the cycles after one, as far back as the ring goes (30 s)."""
        with self._ring() as ring:
            return ring.since(after_seq)

    def until(self, reached: Callable[[CycleRecord], bool], within_s: float = 30) -> CycleRecord:
        """Wait for a record; returns the newest one then.

        Raises:
            ServiceError: none came within the time.
        """
        self.wait(lambda: reached(self.newest()), within_s)
        return self.newest()

    def truth(self) -> list[dict[str, str]]:
        """All rows of the plant's truth, by column."""
        with self.truth_path.open(encoding="utf-8") as file:
            return [row for row in csv.DictReader(file) if row["programme"]]

    @contextlib.contextmanager
    def listener(self) -> Generator[can.BusABC]:
        """A station of python-can on the same bus."""
        bus = self._table["bus"]
        interface = PYTHON_CAN if bus["interface"] == SIMULATED else bus["interface"]
        with can.Bus(interface=interface, channel=bus["channel"]) as station:
            yield station
