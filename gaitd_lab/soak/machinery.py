"""The processes of a soak: virtual drives, core and gateway, each restarted when required."""

import contextlib
import shutil
import signal
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Final

from daemon.ipc.record import CycleRecord, Mode
from daemon.ipc.transport import RING_NAME, RingError, RingReader
from gaitd.remote import Target
from gaitd_lab.demonstration.script import ActError
from gaitd_lab.demonstration.stage import (
    BUS,
    DRIVES_END_S,
    SERVICE_END_S,
    STOPPED,
    ManagedProcess,
    Tempo,
    write_configs,
)
from gaitd_lab.processes import memory_folder
from gaitd_lab.soak.passing import Passing
from sim_drives.time.server import process_state

PARTS: Final = ("sim", "core", "gateway")
"""Names in the order of their start."""
_ENDING: Final = ("core", "gateway", "sim")
_COMPILED_WITHIN_S: Final = 300.0
_POLL_S: Final = 0.01
AT_REST: Final = "S"
"""State of a process that waits, as in proc(5)."""
_STATE_WITHIN_S: Final = 5.0


class Machinery:
    """All processes of one soak, in one folder."""

    def __init__(self, configs: Path, folder: Path, tempo: Tempo) -> None:
        """Prepare; `start` begins."""
        self.folder, self._tempo = folder, tempo
        self.config, endpoint = write_configs(configs, folder / "configs", empty=False)
        table = tomllib.loads(self.config.read_text(encoding="utf-8"))
        self.target = Target((endpoint,), table["zenoh"]["trainer"])
        self.leg: str = table["leg"][0]["name"]
        self.drives = tuple(f"{leg['name']}/{axis}" for leg in table["leg"] for axis in _AXES)
        self.channel = folder / BUS
        self.time = Passing(self.channel, wall_clock=tempo.wall_clock)
        self.ring = folder / "run" / RING_NAME
        self._parts: dict[str, ManagedProcess] = {}
        self._expected_dead: set[str] = set()
        self.start_count: Counter[str] = Counter()
        self.exit_codes: dict[str, int] = {}
        """True at the end of the soak."""
        self.endings: list[str] = []
        """Unexpected ends of processes, each one line."""

    def start(self, part: str) -> None:
        """Start one of PARTS."""
        arguments = [part, "--config", str(self.config)]
        if part == "sim":
            arguments += self._tempo.arguments
        self._expected_dead.discard(part)
        self.start_count[part] += 1
        log = self.folder / f"{part}{self.start_count[part]}.log"
        self._parts[part] = ManagedProcess(f"gaitd {part}", arguments, log)

    def pid(self, part: str) -> int:
        """Process id of the present or the last process."""
        return self._parts[part].pid

    def check(self, part: str) -> None:
        """Check that the process is alive.

        Raises:
            ActError: it is not.
        """
        self._parts[part].check()

    def words(self, part: str) -> str:
        """Return the last output of a process."""
        return self._parts[part].last_words()

    def kill(self, part: str) -> None:
        """Send SIGKILL and wait for the end. `start` starts the process again."""
        self._expected_dead.add(part)
        self._parts[part].signal(signal.SIGKILL)
        self._parts[part].end(SERVICE_END_S)

    def halt(self, part: str, *, on: bool) -> None:
        """Stop a process, or let it continue until it waits again.

        No simulated time passes meanwhile, so a halt has exactly its duration.
        """
        troupe = self._parts[part]
        troupe.signal(signal.SIGSTOP if on else signal.SIGCONT)
        wanted, end_s = STOPPED if on else AT_REST, time.monotonic() + _STATE_WITHIN_S
        while process_state(troupe.pid) != wanted and time.monotonic() < end_s:
            if troupe.exit_code() is not None:
                break
            time.sleep(_POLL_S / 10)

    def revive(self) -> None:
        """Restart processes that ended unexpectedly, as systemd would, and note their end.

        Not the virtual drives: without them there is no time.
        """
        for part in PARTS[1:]:
            troupe = self._parts[part]
            code = troupe.exit_code()
            if code is not None and part not in self._expected_dead:
                self.endings.append(f"gaitd {part} ended with {code}: {troupe.last_words()}")
                self.start(part)

    def end(self) -> None:
        """End all running processes."""
        self.time.close()
        for part in _ENDING:
            if part in self._parts:
                self._parts[part].signal(signal.SIGCONT)
                patience_s = DRIVES_END_S if part == "sim" else SERVICE_END_S
                self.exit_codes[part] = self._parts[part].end(patience_s)


_AXES: Final = ("hip", "slide")


@contextlib.contextmanager
def machinery(configs: Path, tempo: Tempo) -> Generator[Machinery]:
    """Run virtual drives, core and gateway; they are ended in every case."""
    folder = Path(tempfile.mkdtemp(prefix="gaitd-soak-", dir=memory_folder()))
    made = Machinery(configs, folder, tempo)
    try:
        for part in PARTS:
            made.start(part)
        yield made
    finally:
        made.end()
        shutil.rmtree(folder, ignore_errors=True)


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
        if self._follow():
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

    def _follow(self) -> bool:
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


def until_ready(made: Machinery, within_s: float) -> float:
    """Return the seconds from the core's start, which is the call, until it is ready.

    Raises:
        ActError: a process has ended, or the service was not ready in time.
    """
    begun_s = time.monotonic()
    tail = RecordTail(made.ring)
    while time.monotonic() < begun_s + within_s:
        for part in PARTS:
            made.check(part)
        if any(record.mode == Mode.READY for record in tail.read()):
            return time.monotonic() - begun_s
        time.sleep(_POLL_S)
    raise ActError(f"not ready within {within_s:g} s: {made.words('core')}")


def warm_up(configs: Path) -> None:
    """Start everything once: a core that had to compile keeps the compiler's memory.

    Raises:
        ActError: as `until_ready`.
    """
    with machinery(configs, Tempo()) as made:
        until_ready(made, _COMPILED_WITHIN_S)
