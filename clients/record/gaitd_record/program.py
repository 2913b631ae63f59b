"""Messages of a service into recordings: when one begins, and when it ends.

A recording holds messages of one run of a core: another `core_boot_id` is another recording. It
begins with the first message of a mode that is wanted, ends when none has been wanted for two
seconds, and after an hour, or when the clock was set, the next one continues.

Topics may overtake each other by any time. So times between messages are counted in cycles, and
only a cycle that is newer than all wanted ones before can begin a recording.
"""

import contextlib
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import zenoh
from gaitd_client import Mode, MonotonicClock, Trainer, wire
from gaitd_client.clock import UtcClock

from gaitd_record.about import About, Head
from gaitd_record.errors import FullError, RecordError
from gaitd_record.finish import Finished, finish, leftovers
from gaitd_record.recording import IN_ORDER, PART, Received, Recording
from gaitd_record.room import Room

SYNC_NS: Final = 500_000_000
"""Time of the computer between two `sync`: a kill loses at most this, and what `sync` takes."""
ROOM_NS: Final = 5_000_000_000
POLL_S: Final = 0.05
IGNORED_MAX: Final = 100
"""Keys whose messages are reported as none of gaitd's."""
QUEUED_MAX: Final = 100_000
"""Two minutes of messages, while the disk takes none."""
AFTER_NS: Final = 2_000_000_000
"""Recorded after the last wanted mode: how a stop came to rest. A clock that differs by more from
the count of cycles was set; one that NTP slews differs by less in LONGEST_NS."""
LONGEST_NS: Final = 3_600_000_000_000
IDLE: Final = frozenset({Mode.OFF, Mode.BRINGING_UP, Mode.READY, Mode.STOPPING, Mode.FAULT})
"""Modes in which the drives are not enabled on purpose."""


class Purpose(StrEnum):
    """What is recorded."""

    ALL = "all"
    TRAINING = "training"
    """While the drives are enabled on purpose."""
    CALIBRATION = "calibration"
    """Each run of mode excite, and each gait."""

    def wants(self, mode: str | None) -> bool:
        """Return whether this mode is recorded; None: a message without a mode."""
        match self:
            case Purpose.ALL:
                return True
            case Purpose.TRAINING:
                return mode is not None and mode not in IDLE
            case Purpose.CALIBRATION:
                return mode in {Mode.EXCITE, Mode.GAIT}


class Options(NamedTuple):
    """What is recorded, and where."""

    purpose: Purpose
    room: Room


class Listening(NamedTuple):
    """From now on every message is received."""

    service: str


class Begun(NamedTuple):
    """A recording has begun."""

    path: Path


class Deleted(NamedTuple):
    """An old recording was deleted, because the folder is full."""

    path: Path


class Ignored(NamedTuple):
    """A message is none of gaitd's; only the first one of a key is reported."""

    key: str
    reason: str


class Unfinished(NamedTuple):
    """What a kill has left cannot be finished; it stays as it is."""

    path: Path
    reason: str


Event = Listening | Begun | Finished | Deleted | Ignored | Unfinished


class Recorder:
    """Makes recordings of messages; use it as a context manager, which ends the last one."""

    def __init__(
        self,
        options: Options,
        configuration: Callable[[], wire.Configuration],
        report: Callable[[Event], object],
    ) -> None:
        """Finish what a kill has left in the folder, and make room.

        Args:
            options: what is recorded, and where.
            configuration: asks the service for it.
            report: called with each event.

        Raises:
            FullError: there is no room.
            OSError: the folder cannot be read or written.
        """
        self._options, self._configuration, self._report = options, configuration, report
        self._decoder = msgspec.json.Decoder(Head)
        self._ignored: set[str] = set()
        self._recording: Recording | None = None
        self._core = ""
        """The core whose messages are recorded."""
        self._newest_cycles: dict[str, int] = {}
        """By core."""
        self._wanted_cycle, self._begun_cycle = -1, 0
        """The newest cycle of the core with a wanted mode; the first one of the recording."""
        self._finishing: list[Future[Finished | None]] = []
        self._threads = ThreadPoolExecutor(1, thread_name_prefix="finish")
        options.room.folder.mkdir(parents=True, exist_ok=True)
        finish_leftovers(options.room.folder, report)
        self.make_room()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self._threads.shutdown()
        self.collect()

    def add(self, received: Received) -> None:
        """Take a message.

        Raises:
            RecordError: the recording cannot be written.
            ClientError: the service does not tell its configuration.
        """
        try:
            self._add(received, self._decoder.decode(received.payload))
        except (ValueError, RecursionError) as error:
            if received.key not in self._ignored and len(self._ignored) < IGNORED_MAX:
                self._ignored.add(received.key)
                self._report(Ignored(received.key, str(error)))

    def _add(self, received: Received, head: Head) -> None:
        core = head.core_boot_id
        if core is not None and head.cycle is not None and head.sample_time_ns is not None:
            self._change(core, head.cycle, head.sample_time_ns, head.mode)
        recording = self._recording
        if recording is not None:
            self._try(recording, lambda: recording.add(received, head))

    def _change(self, core: str, cycle: int, utc_ns: int, mode: str | None) -> None:
        """End the present recording, begin the next one, or both, where a message asks for it.

        Raises:
            ValueError: the message is a late one of a core before the present one.
        """
        newest = self._newest_cycles.get(core, -1)
        if core != self._core:
            if cycle <= newest:
                raise ValueError("it came after messages of another core")
            self._core, self._wanted_cycle = core, -1
            self.end()
        self._newest_cycles[core] = max(newest, cycle)
        is_newly_wanted = self._options.purpose.wants(mode) and cycle > self._wanted_cycle
        if is_newly_wanted:
            self._wanted_cycle = cycle
        recording = self._recording
        if recording is not None:
            about = recording.about
            since_ns = (cycle - self._begun_cycle) * about.period_ns
            was_set = abs(utc_ns - about.begun_utc_ns - since_ns) > AFTER_NS
            is_over = (cycle - self._wanted_cycle) * about.period_ns > AFTER_NS
            # At a message that begins the next one, so that none is between them.
            if is_over or (is_newly_wanted and (was_set or since_ns > LONGEST_NS)):
                self.end()
        if self._recording is None and is_newly_wanted:
            self._begin(core, utc_ns, mode)
            self._begun_cycle = cycle

    def _begin(self, core: str, utc_ns: int, mode: str | None) -> None:
        about = About.of(self._configuration(), core, utc_ns)
        path = self._options.room.folder / self._name(about, mode)
        try:
            self._recording = Recording(path, about)
        except OSError as error:
            raise RecordError(f"{path}: {error.strerror}") from error
        self._report(Begun(path))

    def _name(self, about: About, mode: str | None) -> str:
        if self._options.purpose is Purpose.CALIBRATION:
            folder = self._options.room.folder
            taken = {path.name.removesuffix(PART) for path in folder.glob(f"{mode}_*")}
            return next(
                name for n in range(1, len(taken) + 2) if (name := f"{mode}_{n}") not in taken
            )
        begun = datetime.fromtimestamp(about.begun_utc_ns // 1_000_000_000, UTC)
        return f"{begun:%Y%m%dT%H%M%SZ}_{about.id[:8]}"

    def sync(self) -> None:
        """Bring all messages to the disk.

        Raises:
            RecordError: the recording cannot be written.
        """
        if self._recording is not None:
            self._try(self._recording, self._recording.sync)
        self.collect()

    def make_room(self) -> None:
        """Keep the limit of the folder.

        Raises:
            FullError: there is no room; the recording has ended.
        """
        try:
            for path in self._options.room.check():
                self._report(Deleted(path))
        except FullError as error:
            self.end(str(error))
            raise

    def end(self, ended: str = IN_ORDER) -> None:
        """End the present recording, if there is one.

        Args:
            ended: why, for readers.

        Raises:
            RecordError: it cannot be written.
        """
        recording, self._recording = self._recording, None
        if recording is not None:
            self._try(recording, lambda: recording.close(ended))
            self._finishing.append(self._threads.submit(finish, recording.part))

    def collect(self) -> None:
        """Report what was finished since the last call.

        Raises:
            RecordError: a recording could not be finished.
        """
        for done in [one for one in self._finishing if one.done()]:
            self._finishing.remove(done)
            try:
                finished = done.result()
            except OSError as error:
                raise RecordError(f"a recording is not finished: {error}") from error
            if finished is not None:
                self._report(finished)

    def _try(self, recording: Recording, action: Callable[[], object]) -> None:
        """Write; a recording that cannot be written is left as it is.

        Raises:
            RecordError: it cannot be written.
        """
        try:
            action()
        except OSError as error:
            self._recording = None
            raise RecordError(
                f"{recording.part}: {error.strerror}; what was written before can be finished"
            ) from error


def finish_leftovers(folder: Path, report: Callable[[Event], object]) -> None:
    """Finish what kills have left in a folder.

    Args:
        folder: of recordings.
        report: called with each one: Finished; Deleted, as it was empty; or Unfinished.

    Raises:
        OSError: one cannot be read or written, for example on a full disk.
    """
    for part in leftovers(folder):
        try:
            report(finish(part) or Deleted(part))
        except RecordError as error:
            report(Unfinished(part, str(error)))


def record(
    trainer: Trainer,
    options: Options,
    report: Callable[[Event], object],
    over: threading.Event,
) -> None:
    """Record a service until `over` is set.

    Args:
        trainer: connected.
        options: what is recorded, and where.
        report: called with each event.
        over: set by another thread, or a signal.

    Raises:
        RecordError: a recording cannot be made; FullError: there is no room.
        ClientError: there is no connection, or the service does not tell its configuration.
        OSError: the folder cannot be read or written.
    """
    received: queue.Queue[Received] = queue.Queue(QUEUED_MAX)
    root = wire.key(trainer.target.trainer, "")
    computer, time_of_day = MonotonicClock(), UtcClock()

    def take(sample: zenoh.Sample) -> None:
        schema = str(sample.encoding).partition(";")[2]
        key = str(sample.key_expr).removeprefix(root)
        with contextlib.suppress(queue.Full):  # counted as lost by its number
            payload = sample.payload.to_bytes()
            received.put_nowait(Received(key, schema, payload, time_of_day.now_ns()))

    with Recorder(options, trainer.configuration, report) as recorder:
        subscriber = trainer.connected_session().declare_subscriber(f"{root}**", take)
        report(Listening(str(trainer.target)))
        synced_ns = checked_ns = computer.now_ns()
        while not over.is_set():
            with contextlib.suppress(queue.Empty):
                recorder.add(received.get(timeout=POLL_S))
            now_ns = computer.now_ns()
            if now_ns - synced_ns >= SYNC_NS:
                synced_ns = now_ns
                recorder.sync()
            if now_ns - checked_ns >= ROOM_NS:
                checked_ns = now_ns
                recorder.make_room()
        subscriber.undeclare()
        while not received.empty():
            recorder.add(received.get())
