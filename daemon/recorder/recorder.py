"""The recorder: black box and request log, as the gateway's loop uses them.

It reads the ring by itself and wraps the queries on their way to the service, so the service does
not depend on it; its reports are returned as events.
"""

import uuid
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from gaitd_names import EventCode

from daemon.gateway.events import EventDraft, Kind, Priority
from daemon.gateway.requests import Inquiry
from daemon.ipc.ring_clip import FOLDER
from daemon.ipc.transport import RingReader
from daemon.recorder.audit_file import RequestFile
from daemon.recorder.audit_log import RequestLog, unexpected_end
from daemon.recorder.black_box import BlackBox
from daemon.recorder.clip_store import ClipStore
from daemon.recorder.disk import Disk, WriteError
from daemon.system.clock import AgeClock

BOOT_ID: Final = "boot_id"
"""File in the runtime directory."""


class DiskRecorder:
    """Black box and request log of one state directory, and the thread that writes both."""

    def __init__(
        self, state: Path, runtime: Path, clock: AgeClock, version: str, *, have_keys: bool = False
    ) -> None:
        """Open the state directory; one that cannot be used is reported as an event, not raised."""
        self._clock = clock
        self._disk = Disk()
        clips = ClipStore(state / FOLDER)
        self._errors = [WriteError("black box", clips.trouble)] if clips.trouble else []
        self._unexpected_end: tuple[EventCode, str] | None = None
        computer_boot_id = _boot_id(runtime)
        try:
            self._unexpected_end = unexpected_end(state, computer_boot_id)
        except OSError as error:
            self._errors.append(WriteError("request log", error.strerror or str(error)))
        self._file = RequestFile(state)
        self._log = RequestLog(
            self._file, self._disk, clock.utc_ns(), version, have_keys, computer_boot_id
        )
        self._box = BlackBox(runtime, clips, self._disk, self._log)
        self._damaged = clips.damaged

    @property
    def not_kept_count(self) -> int:
        """Files and lines that could not be written."""
        return self._disk.failed_count + self._log.lost_count

    def submit(self, what: str, run: Callable[[], None]) -> bool:
        """Run a job of another part of the gateway in the thread that waits for the disk."""
        return self._disk.submit(what, run)

    def wrap(self, inquiries: Sequence[Inquiry]) -> list[Inquiry]:
        """Wrap queries on their way to the service, so that they are logged."""
        return self._log.wrap(inquiries, self._clock.utc_ns())

    def turn(self, ring: RingReader | None, now_ns: int) -> list[EventDraft]:
        """Do the recorder's part of a turn of the loop, and return its events."""
        self._box.turn(ring, now_ns)
        self._log.turn(now_ns, self._clock.utc_ns())
        errors, self._errors = [*self._errors, *self._disk.errors()], []
        damaged, self._damaged = [*self._damaged, *self._box.damaged()], []
        ended, self._unexpected_end = self._unexpected_end, None
        return [
            *([EventDraft(Priority.LOW, Kind.NOTE, ended[0], said=ended[1])] if ended else []),
            *map(_write_error, errors),
            *map(_damaged, damaged),
            *map(_written, self._box.new_files()),
        ]

    def close(self) -> None:
        """Keep what is still open, and finish writing, for a bounded time."""
        self._box.close(self._clock.now_ns())
        self._log.close()
        self._disk.close()


def _boot_id(runtime: Path) -> str:
    """Name of the time since the computer was started; the runtime directory is memory.

    The kernel's own name is in a part of /proc that the service's units hide.
    """
    file = runtime / BOOT_ID
    if not file.exists():
        file.write_text(uuid.uuid4().hex)
    return file.read_text()


def _write_error(error: WriteError) -> EventDraft:
    if not error.reason:
        return EventDraft(Priority.INFO, Kind.NOTE, EventCode.FILE_WRITTEN_AGAIN, said=error.what)
    said = f"{error.what}: {error.reason}"
    return EventDraft(Priority.LOW, Kind.NOTE, EventCode.FILE_NOT_WRITTEN, said=said)


def _damaged(what: str) -> EventDraft:
    return EventDraft(Priority.LOW, Kind.NOTE, EventCode.RECORDING_DAMAGED, said=what)


def _written(name: str) -> EventDraft:
    return EventDraft(Priority.INFO, Kind.NOTE, EventCode.RECORDING_KEPT, said=name)
