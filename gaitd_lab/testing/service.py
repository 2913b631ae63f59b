"""The service and the virtual drives as separate processes, and access to their output.

Time is simulated (`simtime`): a stall of the computer makes a test take longer, and changes no
result. Waiting functions let time pass as fast as it can, and count simulated seconds; otherwise
time has the requested pace, real time by default. While no core is in step, as when its process
starts, time is never faster than the computer's.

The processes themselves are those of `gaitd_lab/processes.py`.
"""

import contextlib
import csv
import signal
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, Final, Self

import can
import msgspec
from gaitd_client import ClientError, Trainer
from gaitd_client.connection import open_session, query

from daemon.config.edits import Edits
from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RingError, RingReader
from daemon.system.clock import AgeClock, MonotonicClock
from gaitd_lab.processes import ManagedProcess, ServiceError, ServiceProcesses, Tempo
from simtime.clock import PageClock
from simtime.link import LinkLostError, SocketLink
from simtime.wire import Role

PYTHON_CAN: Final = "gaitd"
"""Name of the simulated bus for python-can."""
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
DRIVES_READY_S: Final = 60.0
LISTENERS: Final = Path("/proc/net/tcp")
LISTENS: Final = "0A"
"""State of a socket there that listens."""


class Service(ServiceProcesses):
    """The processes of a service, with the control of their time and their output."""

    def __init__(
        self,
        folder: Path,
        configs: Path | None = None,
        *,
        trainer_file: str = "demo.toml",
        edits: Edits | None = None,
        pace: float | str = REAL_TIME,
    ) -> None:
        """As `ServiceProcesses`.

        Args:
            folder: folder of this service alone.
            configs: a folder of configurations.
            trainer_file: name of the trainer file in that folder.
            edits: keys with other values, by file.
            pace: pace of simulated time outside of waits: a multiple of real time, or `max`.

        Raises:
            EditError: a key that does not exist.
        """
        tempo = Tempo(str(pace))
        super().__init__(folder, configs, trainer_file=trainer_file, edits=edits, tempo=tempo)
        self._clock: AgeClock | None = None
        self._hand = SocketLink(self.channel, Role.HAND, "test", timeout_s=HANG_S)
        self._reader: RingReader | None = None
        self._newest_seq = 0
        self._held_count = 0
        self._is_fast = False

    @property
    def clock(self) -> AgeClock:
        """Clock of its records and its truth: simulated, or the computer's on a real bus."""
        if self._clock is None:
            self._clock = PageClock(self.channel) if self.is_on_simulated_bus else MonotonicClock()
        return self._clock

    @property
    def endpoint(self) -> str:
        """Address for Zenoh clients."""
        return self.target.endpoints[0]

    @property
    def trainer(self) -> str:
        """TRAINER of its Zenoh keys, which begin `gaitd/TRAINER/`."""
        return self.target.trainer

    # --- processes ------------------------------------------------------------------------------

    def start_drives(self) -> None:
        """Start the virtual drives and wait until they are on their bus."""
        words = (*self.output_arguments, "--truth-in-silence", *self.time_arguments)
        drives = self.start("sim", *words)
        self._hand.close()

        def on_bus() -> bool:
            drives.check()
            return "virtual drives" in drives.output()

        self.wait(on_bus, DRIVES_READY_S)

    def start_gateway(self) -> ManagedProcess:
        """Start the gateway and wait until it listens: its start takes no simulated time.

        Raises:
            ServiceError: it has ended, or does not listen.
        """
        gateway = self.start("gateway")
        is_held = self.is_on_simulated_bus and self.runs("sim")
        with self.held() if is_held else contextlib.nullcontext():
            for _ in range(round(HANG_S / POLL_S)):
                if self._is_listened_on():
                    return gateway
                gateway.check()
                time.sleep(POLL_S)
        raise ServiceError(f"the gateway does not listen after {HANG_S:g} s\n{self.logs()}")

    def _is_listened_on(self) -> bool:
        """Return whether a process listens on the port of the service."""
        rows = (row.split() for row in LISTENERS.read_text(encoding="ascii").splitlines())
        port = f":{self.zenoh_port:04X}"
        return any(row[1].endswith(port) and row[3] == LISTENS for row in rows)

    def start_all(self) -> Self:
        """Start every part; does not wait for the service to be ready."""
        self.start_drives()
        self.start("core")
        self.start_gateway()
        return self

    def runs(self, part: str) -> bool:
        """Return whether the part was started and has not ended."""
        return part in self.parts and self.parts[part].poll() is None

    def end(self) -> None:
        """End all running parts, in any state and all at once: an orderly end takes time."""
        self._hand.close()
        for process in reversed(self.parts.values()):
            process.send_signal(signal.SIGCONT)
            process.terminate()
        super().end()

    def log(self, part: str) -> str:
        """Return a part's output on stdout and stderr, of all its runs."""
        return (self.folder / f"{part}.log").read_text(encoding="utf-8", errors="replace")

    def said(self) -> list[tuple[str, str]]:
        """Return the last output of each part, by its name."""
        return [(part, process.last_output()) for part, process in self.parts.items()]

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
        data = msgspec.json.encode({"client": "tester", **payload} if payload else {})
        try:
            with open_session(self.target) as session:
                return msgspec.json.decode(query(session, self.target, name, data))
        except ClientError as error:
            return {"outcome": "unanswered", "reason": str(error)}

    def client(self, name: str = "tester") -> Trainer:
        """Return a client of this service, whose silence is of this service's time."""
        target = self.target
        return Trainer(target.endpoints, trainer=target.trainer, client=name, clock=self.clock)

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
        if not self.is_on_simulated_bus:
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
            self._tried_command(f"pace {self.tempo.pace}")

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
        if not self.is_on_simulated_bus or not self.runs("sim"):
            return False
        with contextlib.suppress(LinkLostError):
            self._reply(line)
            return True
        return False

    def _command(self, line: str) -> str:
        if not self.is_on_simulated_bus:
            raise ServiceError(f"{line!r}: time is not simulated on this bus")
        try:
            return self._reply(line)
        except LinkLostError as error:
            raise ServiceError(f"{line!r}: {error}\n{self.logs()}") from error

    def _reply(self, line: str) -> str:
        self._hand.open()
        return self._hand.command(line)

    # --- outputs --------------------------------------------------------------------------------

    def wait(self, reached: Callable[[], object], within_s: float, poll_s: float = POLL_S) -> None:
        """Poll until the condition is true.

        Args:
            reached: the condition, polled.
            within_s: time limit, simulated where time is simulated.
            poll_s: poll interval, of the computer's time; inside `held` of simulated time.

        Raises:
            ServiceError: the time limit has passed, or simulated time stands still.
        """
        failed_polls, checked_ns = 0, self.clock.now_ns()
        end_ns = checked_ns + round(within_s * NS_PER_S)
        with self._fast():
            while failed_polls * poll_s < HANG_S:
                # Before the condition: time may pass fast, or begin anew, while that is checked.
                now_ns = self.clock.now_ns()
                with contextlib.suppress(FileNotFoundError, RingError):
                    if reached():
                        return
                if now_ns >= end_ns:
                    raise ServiceError(f"not reached within {within_s:g} s\n{self.logs()}")
                failed_polls = failed_polls + 1 if now_ns == checked_ns else 0
                checked_ns = now_ns
                self._pass(poll_s)
        raise ServiceError(f"simulated time stood still for {HANG_S:g} s\n{self.logs()}")

    def _ring(self) -> RingReader:
        """Return the ring of the newest core."""
        if self._reader is None or self._reader.inode != self.ring_path.stat().st_ino:
            self._reader, self._newest_seq = RingReader(self.ring_path), 0
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

        can_hold = self.is_on_simulated_bus and self.runs("sim")
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
        bus = self.table["bus"]
        interface = PYTHON_CAN if self.is_on_simulated_bus else bus["interface"]
        with can.Bus(interface=interface, channel=bus["channel"]) as station:
            yield station
