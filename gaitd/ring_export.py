"""A ring of records as a recording: its messages as the gateway published them, without Zenoh."""

import secrets
from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import msgspec
from gaitd_client import wire
from gaitd_record import PART, About, Finished, Head, Received, RecordError, Recording, finish

from daemon.gateway.playback import publish_at_once
from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RingHeader


class RecordingOutlet:
    """Puts the messages of a gateway into a recording."""

    def __init__(self, recording: Recording) -> None:
        """Begin without a message."""
        self._recording = recording
        self._seqs: Counter[tuple[str, ...]] = Counter()

    def next_seq(self, *parts: str) -> int:
        """See `Outlet`."""
        self._seqs[parts] += 1
        return self._seqs[parts]

    def put(self, message: msgspec.Struct, *parts: str) -> None:
        """See `Outlet`."""
        payload = msgspec.json.encode(message)
        head = msgspec.json.decode(payload, type=Head)
        # It was not received: its log time is the trainer's time, as its publish time.
        utc_ns = head.sample_time_ns or self._recording.about.begun_utc_ns
        made = Received("/".join(parts), wire.schema_name(type(message)), payload, utc_ns)
        self._recording.add(made, head)

    def put_event(self, event: wire.Event) -> None:
        """See `Outlet`."""
        self.put(event, wire.EVENTS)

    def links(self) -> list[tuple[str, str, str | None]]:
        """Return none: there are no clients."""
        return []

    def set_alive(self, alive: bool) -> None:
        """Do nothing: a recording has no liveliness."""


def export(header: RingHeader, records: Sequence[CycleRecord], path: Path) -> Finished:
    """Write a recording.

    Args:
        header: of the ring.
        records: at least one, oldest first.
        path: folder of the recording; it must not exist.

    Raises:
        RecordError: there is such a folder, or the recording has no message.
        OSError: it cannot be written.
    """
    about = About(
        id=secrets.token_hex(8),
        trainer=header.trainer,
        core_boot_id=header.core_boot_id,
        gaitd_version=header.version,
        recorder_version=version("gaitd-record"),
        period_ns=header.period_ns,
        leg_names=header.leg_names,
        drive_names=header.drive_names,
        joints=wire.JOINTS,
        config_hashes=header.config_hashes,
        robot=header.robot,
        limits=header.limits,
        begun_utc_ns=records[0].sync_utc_ns,
    )
    recording = Recording(path, about)
    publish_at_once(header, records, RecordingOutlet(recording))
    recording.close()
    finished = finish(recording.part)
    if finished is None:
        raise RecordError(f"{path}{PART}: has no message")
    return finished
