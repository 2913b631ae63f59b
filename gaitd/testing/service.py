"""The service and the virtual drives as separate processes, and access to their output.

Time is simulated (`simtime`): a stall of the computer makes a test take longer, and changes no
result. Waiting functions let time pass as fast as it can, and count simulated seconds; otherwise
time has the requested pace, real time by default. While no core is in step, as when its process
starts, time is never faster than the computer's.

Every part is a process of its own (`gaitd sim`, `gaitd core`, `gaitd gateway`) with its output in
a file. None outlives this process: `end` ends it, and the kernel kills it if this process dies.
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

from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RING_NAME, RingError, RingReader
from daemon.system.clock import AgeClock, MonotonicClock, PageClock
from gaitd import remote
from gaitd.command_line import configs_folder
from gaitd.remote import Target
from gaitd.testing.edits import Edits, edit
from gaitd_lab.processes import free_ports, tied
from simtime.link import LinkLostError, SocketLink
from simtime.wire import Role

SIMULATED, PYTHON_CAN = "simulated", "gaitd"
"""The bus of simulated time, and python-can's name for it."""
POLL_S: Final = 0.02
CYCLE_S: Final = 0.01
STEP_S: Final = 0.05
"""Simulated time between two reads of the records; while a test holds time, a cycle."""
IN_STEP_NS: Final = 100_000_000
"""If the newest record is older than this, the core is not in step, or not yet."""
HANG_S: Final = 60.0
"""If simulated time stands still for this much of the computer's time, a process hangs."""
RUN_MAX_NS: Final = 1_000_000_000
"""Largest advance requested of the virtual drives at once: each may take HANG_S."""
NS_PER_S: Final = 1_000_000_000
REAL_TIME: Final = 1.0
GAITD: Final = ("-m", "gaitd")
END_S: Final = 10.0
"""The core stops both axes before it ends."""
DRIVES_READY_S: Final = 60.0
LOG_TAIL: Final = 4000


class ServiceError(AssertionError):
    """A wait has failed; the message contains the last output of every process."""


class Service:
    """Virtual drives, core and gateway of one configuration, with ports and folders of its own."""

    def __init__(
        self,
        folder: Path,
        configs: Path | None = None,
        *,
        trainer_file: str = "demo.toml",
        edits: Edits | None = None,
        pace: float | str = REAL_TIME,
        wall_clock: bool = False,
    ) -> None:
        """Write the configuration; no process is started.

        Args:
            folder: folder of this service alone; all its files go there.
            configs: a folder of configurations, copied; None: those that come with gaitd.
            trainer_file: name of the trainer file in that folder.
            edits: keys with other values, by file; they override the ports and paths set here.
            pace: pace of simulated time outside of waits: a multiple of real time, or `max`.
            wall_clock: the simulated bus uses the computer's clock, and nothing can be held.

        Raises:
            EditError: a key that does not exist.
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
        bus = self._table["bus"]
        self._pace, self._wall_clock = str(pace), wall_clock
        self._is_simulated: bool = bus["interface"] == SIMULATED and not wall_clock
        self._hand = SocketLink(Path(bus["channel"]), Role.HAND, "test", patience_s=HANG_S)
        self._reader: RingReader | None = None
        self._newest_seq = 0
        self._held_count = 0
        self._is_fast = False
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
        """Clock of its records and its truth: simulated, or the computer's on a real bus."""
        bus = self._table["bus"]
        if self._clock is None:
            simulated = bus["interface"] == SIMULATED
            self._clock = PageClock(Path(bus["channel"])) if simulated else MonotonicClock()
        return self._clock

    @property
    def endpoint(self) -> str:
        """Address for Zenoh clients."""
        return self._table["zenoh"]["listen"][0]

    @property
    def trainer(self) -> str:
        """TRAINER of its Zenoh keys, which begin `gaitd/TRAINER/`."""
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
            arguments: arguments besides `--config`.
            program: program that runs `gaitd PART`, if it is not `gaitd` itself.
            environment: additional environment variables.
        """
        words = (*program, part, "--config", str(self.config), *arguments)
        with (self.folder / f"{part}.log").open("ab") as log:
            self.parts[part] = subprocess.Popen(
                # Killed with this process, because a stopped part obeys nothing else.
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
        speed = ("--pace", self._pace) if self._is_simulated else ()
        clock = ("--wall-clock",) if self._wall_clock else ()
        drives = self.start("sim", *places, "--truth-in-silence", *speed, *clock)
        self._hand.close()

        def on_bus() -> bool:
            if drives.poll() is not None:
                raise ServiceError(f"gaitd sim ended with {drives.returncode}\n{self.logs()}")
            return b"virtual drives" in log.read_bytes()[said_before:]

        self.wait(on_bus, DRIVES_READY_S)

    def start_all(self) -> Self:
        """Start every part; does not wait for the service to be ready."""
        self.start_drives()
        self.start("core")
        self.start("gateway")
        return self

    def kill(self, part: str, number: int = signal.SIGKILL) -> None:
        """Send a part a signal; for SIGKILL, wait until it has ended."""
        os.kill(self.parts[part].pid, number)
        if number == signal.SIGKILL:
            self.parts[part].wait()

    def runs(self, part: str) -> bool:
        """Return whether the part was started and has not ended."""
        return part in self.parts and self.parts[part].poll() is None

    def end(self) -> None:
        """End all running parts, in any state."""
        self._hand.close()
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
        """Return a part's output on stdout and stderr, of all its runs."""
        return (self.folder / f"{part}.log").read_text(encoding="utf-8", errors="replace")

    def said(self) -> list[tuple[str, str]]:
        """Return the last output of each part, by its name."""
        return [(part, self.log(part)[-LOG_TAIL:] or "(nothing)") for part in self.parts]

    def logs(self) -> str:
        """Return the same as one text."""
        return "\n".join(f"--- gaitd {part}\n{words}" for part, words in self.said())

    # --- requests -------------------------------------------------------------------------------

    def request(self, name: str, **payload: object) -> dict[str, Any]:
        """Query control/NAME; return the answer, `unanswered` if there is none.

        Raises:
            ServiceError: time is held, so the core can decide nothing.
        """
        if self._held_count:
            raise ServiceError(f"control/{name} is asked while time is held: it needs time to pass")
        target = Target((self.endpoint,), self.trainer)
        answer = remote.ask(target, name, {"client": "tester", **payload} if payload else {})
        if answer.text is None:
            return {"outcome": "unanswered", "reason": answer.trouble}
        return msgspec.json.decode(answer.text)

    def inject(self, line: str) -> str:
        """Send the virtual drives a command, e.g. `silent right/hip 0.5`; return the answer."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
            own = self.folder / f"tester{time.monotonic_ns()}"
            end.bind(str(own))
            end.settimeout(5)
            try:
                end.sendto(line.encode(), str(self.control_path))
                return end.recv(4096).decode()
            finally:
                own.unlink()

    # --- time ---------------------------------------------------------------------------------

    @contextlib.contextmanager
    def held(self) -> Generator[None]:
        """Hold time inside the context, except for `run`, `until` and waits for a record.

        Every process has completed its computations at entry. A request is refused inside.

        Raises:
            ServiceError: time is not simulated, or the virtual drives do not answer.
        """
        if not self._held_count:
            self._command("hold")
            self._command("run 0")
        self._held_count += 1
        try:
            yield
        finally:
            self._held_count -= 1
            if not self._held_count:
                self._tried_command("go")

    def run(self, duration_s: float) -> None:
        """Let exactly this much simulated time pass, as fast as it can; then all have computed.

        On a bus in real time this is a sleep.

        Raises:
            ServiceError: the virtual drives do not answer.
        """
        if not self._is_simulated:
            time.sleep(duration_s)
            return
        left_ns = round(duration_s * NS_PER_S)
        with self.held():
            while left_ns > 0:
                part_ns = min(left_ns, RUN_MAX_NS)
                self._command(f"run {part_ns / NS_PER_S:.9f}")
                left_ns -= part_ns

    def at(self, delay_s: float, line: str) -> str:
        """Schedule the command `line` for exactly this many simulated seconds from now.

        Inside `held` now is the instant at which time is held. Errors of the command appear in the
        log of the virtual drives.

        Raises:
            ServiceError: time is not simulated, or the virtual drives do not answer.
        """
        return self._command(f"at {delay_s:.9f} {line}")

    @contextlib.contextmanager
    def _fast(self) -> Generator[None]:
        """Let time pass as fast as it can inside, where it is simulated and there are drives."""
        if self._is_fast or self._held_count or not self._tried_command("pace max"):
            yield
            return
        self._is_fast = True
        try:
            yield
        finally:
            self._is_fast = False
            self._tried_command(f"pace {self._pace}")

    def _pass(self, poll_s: float) -> None:
        """Let time pass between two reads."""
        if not self._held_count:
            time.sleep(poll_s)
            return
        self.run(poll_s)
        if not self._counts():
            time.sleep(poll_s)

    def _counts(self) -> bool:
        """Return whether the core is in step."""
        with contextlib.suppress(FileNotFoundError, RingError):
            return self.clock.now_ns() - self.newest().sync_mono_ns < IN_STEP_NS
        return False

    def _tried_command(self, line: str) -> bool:
        """Send a command if time is simulated and the drives run; return whether it was sent."""
        if not self._is_simulated or not self.runs("sim"):
            return False
        with contextlib.suppress(LinkLostError):
            self._told(line)
            return True
        return False

    def _command(self, line: str) -> str:
        if not self._is_simulated:
            raise ServiceError(f"{line!r}: time is not simulated on this bus")
        try:
            return self._told(line)
        except LinkLostError as error:
            raise ServiceError(f"{line!r}: {error}\n{self.logs()}") from error

    def _told(self, line: str) -> str:
        self._hand.open()
        return self._hand.command(line)

    # --- outputs --------------------------------------------------------------------------------

    @property
    def truth_path(self) -> Path:
        """CSV file of the plant's true state."""
        return self.folder / "truth.csv"

    @property
    def control_path(self) -> Path:
        """Command socket of the virtual drives."""
        return self.folder / "ctl"

    def wait(self, reached: Callable[[], object], within_s: float, poll_s: float = POLL_S) -> None:
        """Poll until the condition is true.

        Args:
            reached: the condition, polled.
            within_s: time limit, simulated where time is simulated.
            poll_s: poll interval, of the computer's time; inside `held` of simulated time.

        Raises:
            ServiceError: the time limit has passed, or simulated time stands still.
        """
        looks_in_vain, seen_ns = 0, self.clock.now_ns()
        end_ns = seen_ns + round(within_s * NS_PER_S)
        with self._fast():
            while looks_in_vain * poll_s < HANG_S:
                with contextlib.suppress(FileNotFoundError, RingError):
                    if reached():
                        return
                now_ns = self.clock.now_ns()
                if now_ns >= end_ns:
                    raise ServiceError(f"not reached within {within_s:g} s\n{self.logs()}")
                looks_in_vain = looks_in_vain + 1 if now_ns == seen_ns else 0
                seen_ns = now_ns
                self._pass(poll_s)
        raise ServiceError(f"simulated time stood still for {HANG_S:g} s\n{self.logs()}")

    def _ring(self) -> RingReader:
        """Return the ring of the newest core."""
        path = self.config.parent / self._table["paths"]["runtime"] / RING_NAME
        if self._reader is None or self._reader.inode != path.stat().st_ino:
            self._reader, self._newest_seq = RingReader(path), 0
        return self._reader

    def _followed(self) -> tuple[RingReader, int]:
        """Return the ring and its newest number: followed from there, or read from its start."""
        ring = self._ring()
        if not self._newest_seq or ring.raw(self._newest_seq) is None:
            self._newest_seq = ring.newest_seq()
        if not self._newest_seq:
            raise FileNotFoundError("no record yet")
        while ring.raw(self._newest_seq + 1) is not None:
            self._newest_seq += 1
        return ring, self._newest_seq

    def boot_id(self) -> str:
        """Boot id of the core that wrote the ring; empty if there is none yet."""
        try:
            return self._ring().header.core_boot_id
        except FileNotFoundError:
            return ""

    def newest(self) -> CycleRecord:
        """Return the record of the newest cycle.

        Raises:
            FileNotFoundError, RingError: there is none yet.
        """
        ring, seq = self._followed()
        record = ring.read(seq)
        if record is None:
            raise RingError(f"record {seq} cannot be read")
        return record

    def records(self, after_seq: int = 0) -> list[CycleRecord]:
        """Return the records of the cycles after one, as far back as the ring goes (30 s)."""
        return self._ring().since(after_seq)

    def until(self, reached: Callable[[CycleRecord], bool], within_s: float = 30) -> CycleRecord:
        """Wait for the first record, from the newest one on, that meets the condition; return it.

        Inside `held` time then stands in its cycle; otherwise some cycles later.

        Raises:
            ServiceError: none came within the time.
        """
        found: list[CycleRecord] = []
        seen: list[RingReader] = []
        seq = 0

        def looked() -> bool:
            nonlocal seq
            ring, newest = self._followed()
            first = seq + 1 if [ring] == seen else newest
            seen[:], seq = [ring], newest
            for number in range(first, newest + 1):
                record = ring.read(number)
                if record is not None and reached(record):
                    found.append(record)
                    return True
            return False

        can_hold = self._is_simulated and self.runs("sim")
        poll_s = CYCLE_S if self._held_count else STEP_S if can_hold else POLL_S
        with self.held() if can_hold else contextlib.nullcontext():
            self.wait(looked, within_s, poll_s)
        return found[0]

    def truth(self) -> list[dict[str, str]]:
        """Return all rows of the plant's truth, by column."""
        with self.truth_path.open(encoding="utf-8") as file:
            return [row for row in csv.DictReader(file) if row["programme"]]

    @contextlib.contextmanager
    def listener(self) -> Generator[can.BusABC]:
        """Return a python-can bus on the same channel."""
        bus = self._table["bus"]
        interface = PYTHON_CAN if bus["interface"] == SIMULATED else bus["interface"]
        with can.Bus(interface=interface, channel=bus["channel"]) as station:
            yield station
