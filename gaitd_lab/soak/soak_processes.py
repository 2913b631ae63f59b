"""The processes of a soak: virtual drives, core and gateway, each restarted when required."""

import contextlib
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Final

from daemon.ipc.record import CycleRecord, Mode
from daemon.ipc.transport import RingError, RingReader
from gaitd_lab.processes import (
    GAITD,
    ManagedProcess,
    ServiceError,
    ServiceProcesses,
    Tempo,
    memory_folder,
)
from gaitd_lab.soak.time_control import TimeControl
from simtime.processes import STOPPED, process_state

PARTS: Final = ("sim", "core", "gateway")
"""Names in the order of their start."""
_COMPILED_WITHIN_S: Final = 300.0
_POLL_S: Final = 0.01
AT_REST: Final = "S"
"""State of a process that waits, as in proc(5)."""
_STATE_WITHIN_S: Final = 5.0
_AXES: Final = ("hip", "slide")


class SoakProcesses(ServiceProcesses):
    """All processes of one soak, and its time."""

    def __init__(self, configs: Path, folder: Path, tempo: Tempo) -> None:
        """Prepare; `start` begins."""
        super().__init__(folder, configs, tempo=tempo)
        self.drives = tuple(f"{leg['name']}/{axis}" for leg in self.table["leg"] for axis in _AXES)
        self.time = TimeControl(self.channel, wall_clock=tempo.wall_clock)
        self._expected_dead: set[str] = set()
        self.start_count: Counter[str] = Counter()
        self.endings: list[str] = []
        """Unexpected ends of processes, each one line."""

    def start(
        self,
        part: str,
        *arguments: str,
        program: Sequence[str] = GAITD,
        environment: Mapping[str, str] | None = None,
    ) -> ManagedProcess:
        """Start one of PARTS, and count it."""
        self._expected_dead.discard(part)
        self.start_count[part] += 1
        arguments += self.time_arguments if part == "sim" else ()
        return super().start(part, *arguments, program=program, environment=environment)

    def kill(self, part: str, number: int = signal.SIGKILL) -> None:
        """End a process by a signal, which is expected. `start` starts it again."""
        self._expected_dead.add(part)
        super().kill(part, number)

    def halt(self, part: str, *, on: bool) -> None:
        """Stop a process, or let it continue until it waits again.

        No simulated time passes meanwhile, so a halt has exactly its duration.
        """
        process = self.parts[part]
        process.send_signal(signal.SIGSTOP if on else signal.SIGCONT)
        wanted, end_s = STOPPED if on else AT_REST, time.monotonic() + _STATE_WITHIN_S
        while process_state(process.pid) != wanted and time.monotonic() < end_s:
            if process.poll() is not None:
                break
            time.sleep(_POLL_S / 10)

    def restart_ended(self) -> None:
        """Restart processes that ended unexpectedly, as systemd would, and note their end.

        Not the virtual drives: without them there is no time.
        """
        for part in PARTS[1:]:
            process = self.parts[part]
            if process.poll() is not None and part not in self._expected_dead:
                ended = f"gaitd {part} ended with {process.returncode}"
                self.endings.append(f"{ended}: {process.last_output()}")
                self.start(part)

    def end(self) -> None:
        """End all running processes; simulated time passes by itself meanwhile."""
        self.time.close()
        super().end()


@contextlib.contextmanager
def soak_processes(configs: Path, tempo: Tempo) -> Generator[SoakProcesses]:
    """Run virtual drives, core and gateway; they are ended in every case."""
    with (
        tempfile.TemporaryDirectory(prefix="gaitd-soak-", dir=memory_folder()) as folder,
        SoakProcesses(configs, Path(folder), tempo) as made,
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


def until_ready(made: SoakProcesses, within_s: float) -> float:
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


def warm_up(configs: Path) -> None:
    """Start everything once: a core that had to compile keeps the compiler's memory.

    Raises:
        ServiceError: as `until_ready`.
    """
    with soak_processes(configs, Tempo()) as made:
        until_ready(made, _COMPILED_WITHIN_S)
