"""Virtual drives, core and gateway as processes, with control of their time."""

import contextlib
import tempfile
import time
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Final

from gaitd_names import Mode

from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RingError, RingReader
from gaitd_lab.processes import (
    GAITD,
    ManagedProcess,
    ServiceError,
    ServiceProcesses,
    Tempo,
    memory_folder,
)
from simtime.clock import PageClock
from simtime.link import LinkLostError, SocketLink
from simtime.wire import Role

PARTS: Final = ("sim", "core", "gateway")
"""Names in the order of their start."""
_COMPILED_WITHIN_S: Final = 300.0
_POLL_S: Final = 0.02
SERVED_WITHIN_S: Final = 300.0
"""Time limit: the first start of the virtual drives compiles their plant."""


class TimeControl:
    """Controls the time of the virtual drives (`sim_drives/time/server.py`)."""

    def __init__(self, channel: Path, *, wall_clock: bool) -> None:
        """Time passes by itself until `hold`.

        Args:
            channel: socket of the virtual drives.
            wall_clock: time is the computer's.
        """
        self._is_wall_clock = wall_clock
        self._link = SocketLink(channel, Role.HAND, "laboratory")
        self._clock = PageClock(channel)

    def hold(self) -> None:
        """Hold simulated time from now on, but for commands `run`; waits for the virtual drives.

        Raises:
            LinkLostError: they do not answer.
        """
        end_s = time.monotonic() + SERVED_WITHIN_S
        while True:
            try:
                self._link.open()
                break
            except LinkLostError:
                if time.monotonic() > end_s:
                    raise
                time.sleep(_POLL_S)
        if not self._is_wall_clock:
            self._link.command("hold")

    def now_s(self) -> float:
        """Time of the core's clock."""
        return self._clock.now_ns() * 1e-9

    def command_drives(self, words: str) -> None:
        """Send commands to the virtual drives, one a line, at this instant.

        Raises:
            LinkLostError: they have ended.
            ValueError: they refuse one.
        """
        for line in words.splitlines():
            self._link.command(line)

    def close(self) -> None:
        """Let time pass by itself again."""
        self._link.close()


class TimedService(ServiceProcesses):
    """The processes of one service, and their time."""

    def __init__(
        self, configs: Path, folder: Path, tempo: Tempo, trainer_file: str = "demo.toml"
    ) -> None:
        """Prepare; `start` begins."""
        super().__init__(folder, configs, trainer_file=trainer_file, tempo=tempo)
        self.time = TimeControl(self.channel, wall_clock=tempo.wall_clock)

    def start(
        self,
        part: str,
        *arguments: str,
        program: Sequence[str] = GAITD,
        environment: Mapping[str, str] | None = None,
    ) -> ManagedProcess:
        """Start one of PARTS."""
        arguments += self.time_arguments if part == "sim" else ()
        return super().start(part, *arguments, program=program, environment=environment)

    def end(self) -> None:
        """End all running processes; simulated time passes by itself meanwhile."""
        self.time.close()
        super().end()


@contextlib.contextmanager
def timed_service(
    configs: Path, tempo: Tempo, trainer_file: str = "demo.toml"
) -> Generator[TimedService]:
    """Run virtual drives, core and gateway; they are ended in every case."""
    with (
        tempfile.TemporaryDirectory(prefix="gaitd-", dir=memory_folder()) as folder,
        TimedService(configs, Path(folder), tempo, trainer_file) as made,
    ):
        for part in PARTS:
            made.start(part)
        yield made


class RecordTail:
    """Reads new records of the ring, across restarts of the core."""

    def __init__(self, path: Path) -> None:
        """Read from `path`, which need not exist yet."""
        self._path = path
        self._ring: RingReader | None = None
        self._seq = 0
        self.lost_count = 0
        """Number of records overwritten before they were read here."""

    def read(self) -> list[CycleRecord]:
        """Return all records since the last call, oldest first."""
        found = self._forward()
        if self._open_ring():
            found += self._forward()
        return found

    def _forward(self) -> list[CycleRecord]:
        ring, found = self._ring, []
        if ring is None:
            return found
        while (record := ring.read(self._seq + 1)) is not None:
            found.append(record)
            self._seq += 1
        if not found and (newest := ring.newest_seq()) > self._seq:
            oldest = ring.oldest_seq(newest)
            self.lost_count += max(oldest - self._seq - 1, 0)
            found = ring.since(self._seq)
            self._seq = found[-1].seq if found else self._seq
        return found

    def _open_ring(self) -> bool:
        """Return whether a new core has started."""
        try:
            inode = self._path.stat().st_ino
            if self._ring is not None and self._ring.inode == inode:
                return False
            self._ring = RingReader(self._path)
        except (FileNotFoundError, RingError):
            return False
        self._seq = 0
        return True


def until_ready(made: TimedService, within_s: float) -> float:
    """Return the seconds from the core's start, which is the call, until it is ready.

    Raises:
        ServiceError: a process has ended, or the service was not ready in time.
    """
    begun_s = time.monotonic()
    tail = RecordTail(made.ring_path)
    while time.monotonic() < begun_s + within_s:
        made.check()
        if any(record.mode == Mode.READY for record in tail.read()):
            return time.monotonic() - begun_s
        time.sleep(_POLL_S)
    raise ServiceError(f"not ready within {within_s:g} s: {made.parts['core'].last_output()}")


def warm_up(configs: Path, trainer_file: str = "demo.toml") -> None:
    """Start everything once: a core that had to compile keeps the compiler's memory.

    Raises:
        ServiceError: as `until_ready`.
    """
    with timed_service(configs, Tempo(), trainer_file) as made:
        until_ready(made, _COMPILED_WITHIN_S)
