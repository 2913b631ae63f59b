"""The end of a recording: Parquet of events and estimates, then the folder gets its name.

The same for a recording that ended in order and for one whose recorder was killed; there the MCAP
file has no end, and is written anew from what it has. Each step can be done again after a kill.
"""

import contextlib
import fcntl
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import zstandard
from gaitd_client import wire
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from gaitd_record.about import CONFIGURATION, END_NAME, NAME, About, Head, Journal
from gaitd_record.columns import Arrow
from gaitd_record.disk import sync_folder
from gaitd_record.errors import RecordError
from gaitd_record.event_table import EVENTS, write_events
from gaitd_record.leg_table import ENDS, NS_PER_S, STREAM, batches, write_parquet
from gaitd_record.recording import CHUNK_BYTES, ESTIMATE, MESSAGES, PART, TOPIC

TORN: Final = "torn: the recorder was killed, or the power failed"
RECORD_BYTES_MAX: Final = 1 << 26
"""A torn file may claim a record of any size; none of ours is larger."""
TORN_ERRORS: Final = (McapError, EOFError, ValueError, struct.error, zstandard.ZstdError)
"""What the reader of MCAP raises where a file is torn."""


class Finished(NamedTuple):
    """A finished recording."""

    path: Path
    ended: str
    """`in order`, or why not."""
    message_count: int
    size_bytes: int
    begun_utc_ns: int
    end_utc_ns: int
    lost: dict[str, int]
    """Messages that were published and not received, by key."""


def leftovers(folder: Path) -> list[Path]:
    """List the unfinished recordings of a folder that are not being made."""
    parts = sorted(file.parent for file in folder.glob(f"*{PART}/{MESSAGES}"))
    return [part for part in parts if not _is_locked(part)]


def _is_locked(part: Path) -> bool:
    try:
        with (part / MESSAGES).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


def finish(part: Path) -> Finished | None:
    """Make a recording of a folder `NAME.part` that is not being made any more.

    Returns: None if nothing had been recorded; the folder is then removed.

    Raises:
        RecordError: the folder is no unfinished recording, or of another version, or its name is
            taken.
        OSError: it cannot be read or written, for example on a full disk; then it stays as it is.
    """
    path = part.with_name(part.name.removesuffix(PART))
    if part == path or not (part / MESSAGES).is_file():
        raise RecordError(f"{part}: is no unfinished recording, a folder *{PART} with {MESSAGES}")
    if path.exists():
        raise RecordError(f"{part}: cannot become {path}, which is there already")
    if not _is_whole(part / MESSAGES) and not _mend(part):
        remove(part)
        return None
    about, end = _read(part / MESSAGES)
    told = {
        NAME.encode(): msgspec.json.encode(about),
        END_NAME.encode(): msgspec.json.encode(end),
    }
    try:
        write_events(part / MESSAGES, TOPIC + wire.EVENTS, told)
    except ValueError as error:
        raise RecordError(f"{part / MESSAGES}: an event is of another version: {error}") from error
    for stream in sorted(part.glob(f"*{STREAM}")):
        leg = stream.name.removesuffix(STREAM)
        write_parquet(stream, about, {**told, b"gaitd.leg": leg.encode()})
        sync_folder(part)  # without the new names on the disk the old file must stay
        stream.unlink()
    _make_newest(part)
    part.rename(path)
    sync_folder(path.parent)
    size_bytes = sum(file.stat().st_size for file in path.iterdir())
    return Finished(
        path,
        end["ended"],
        int(end["message_count"]),
        size_bytes,
        about.begun_utc_ns,
        int(end["end_utc_ns"]),
        msgspec.json.decode(end["lost"], type=dict[str, int]),
    )


def _make_newest(part: Path) -> None:
    """Let no finished recording seem younger: the clock may have lost its time since."""
    own = part / MESSAGES
    time_ns = own.stat().st_mtime_ns
    for other in part.parent.glob(f"*/{MESSAGES}"):
        with contextlib.suppress(FileNotFoundError):  # deleted meanwhile, to make room
            if other.stat().st_mtime_ns > time_ns:
                time_ns = other.stat().st_mtime_ns + NS_PER_S
    os.utime(own, ns=(time_ns, time_ns))


def remove(recording: Path) -> None:
    """Delete a recording; what else lies in its folder stays, and then the folder, too.

    Raises:
        OSError: it cannot be deleted.
    """
    names = (MESSAGES, EVENTS, f"*{STREAM}", *(f"*{end}" for end in ENDS))
    ours = [*names, *(f"{name}.new" for name in names)]
    for file in [file for name in ours for file in recording.glob(name)]:
        file.unlink()
    if not any(recording.iterdir()):
        recording.rmdir()


def _is_whole(messages: Path) -> bool:
    """Return whether an MCAP file has its end."""
    try:
        with messages.open("rb") as file:
            summary = make_reader(file).get_summary()
            return summary is not None and END_NAME in {
                index.name for index in summary.metadata_indexes
            }
    except (FileNotFoundError, *TORN_ERRORS):
        return False


def _read(messages: Path) -> tuple[About, dict[str, str]]:
    """Return what a whole MCAP file says of itself at its begin and at its end."""
    with messages.open("rb") as file:
        reader = make_reader(file)
        texts = {one.name: one.metadata for one in reader.iter_metadata()}
        attached = {one.name: one.data for one in reader.iter_attachments()}
    try:
        return About.read(texts[NAME], attached[CONFIGURATION]), texts[END_NAME]
    except (KeyError, ValueError) as error:
        raise RecordError(f"{messages}: is of another program or version: {error}") from error


def _mend(part: Path) -> bool:
    """Write a torn MCAP file anew, with an end.

    Returns: whether there was anything to keep.

    Raises:
        RecordError: what was written cannot be read.
    """
    torn, draft = part / MESSAGES, part / f"{MESSAGES}.new"
    journal = Journal()
    with draft.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES)
        writer.start(profile="", library="gaitd-record")
        kept = {type(record) for record in _copied(torn, writer, journal)}
        if not {Attachment, Metadata} <= kept:
            return False
        mcap_count = journal.message_count
        for stream in part.glob(f"*{STREAM}"):
            key = f"{stream.name.removesuffix(STREAM)}/{ESTIMATE}"
            for batch in batches(stream):
                _count(journal, key, batch)
        writer.add_metadata(END_NAME, journal.metadata(TORN))
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
    with draft.open("rb") as file:
        summary = make_reader(file).get_summary()
    statistics = summary.statistics if summary else None
    if statistics is None or statistics.message_count != mcap_count:
        raise RecordError(f"{draft}: has not the {mcap_count} messages that were written")
    draft.replace(torn)
    return True


def _copied(torn: Path, writer: Writer, journal: Journal) -> Iterator[McapRecord]:
    """Copy the records of a file up to where it is torn, and yield each."""
    channels: dict[int, tuple[int, str]] = {}
    schemas: dict[int, int] = {0: 0}
    for record in _records(torn):
        if _has_hole(record):
            return
        match record:
            case Attachment():
                times = record.create_time, record.log_time
                writer.add_attachment(*times, record.name, record.media_type, record.data)
            case Metadata() if record.name == NAME:
                writer.add_metadata(record.name, record.metadata)
            case Schema() if record.id not in schemas:
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
            case Channel() if record.id not in channels:
                schema_id = schemas[record.schema_id]
                made = writer.register_channel(record.topic, record.message_encoding, schema_id)
                channels[record.id] = made, record.topic.removeprefix(TOPIC)
            case Message():
                channel, key = channels[record.channel_id]
                journal.add(key, msgspec.json.decode(record.data, type=Head))
                if key == wire.SAFETY:
                    journal.add_safety(record.data)
                writer.add_message(
                    channel, record.log_time, record.data, record.publish_time, record.sequence
                )
            case _:
                continue
        yield record


def _has_hole(record: McapRecord) -> bool:
    """Return whether bytes are missing in the head, which has no checksum that the reader checks.

    The head is synced before any message is taken: where it is torn nothing has been recorded.
    """
    match record:
        case Attachment():
            return b"\0" in record.data
        case Metadata():
            return "\0" in "".join((*record.metadata, *record.metadata.values()))
        case _:
            return False


def _records(torn: Path) -> Iterator[McapRecord]:
    try:
        with torn.open("rb") as file:
            reader = StreamReader(file, validate_crcs=True, record_size_limit=RECORD_BYTES_MAX)
            yield from reader.records
    except (FileNotFoundError, *TORN_ERRORS):
        return


def _count(journal: Journal, key: str, batch: Arrow) -> None:
    columns = batch.select(["seq", "cycle", "sample_time_ns"]).to_pydict()
    for seq, cycle, utc_ns in zip(*columns.values(), strict=True):
        journal.add(key, Head(seq, None, cycle, utc_ns))
