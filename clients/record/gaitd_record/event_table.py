"""Events as a table, one row for each: modes, stops, refused requests, drives, notes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec
import pyarrow as pa
from gaitd_client import wire
from mcap.reader import make_reader

from gaitd_record.about import Count
from gaitd_record.columns import EVENTS_SCHEMA
from gaitd_record.disk import replace
from gaitd_record.leg_table import parquet

EVENTS: Final = "events.parquet"


class _Event(wire.Event, frozen=True, kw_only=True):
    """An event whose numbers have a place in a column."""

    cycle: Count | None
    time_ns: Count


_DECODER: Final = msgspec.json.Decoder(_Event)


def check_event(payload: bytes) -> None:
    """Check a message `events`, before it is taken.

    Raises:
        ValueError: it is none.
    """
    _DECODER.decode(payload)


def write_events(messages: Path, topic: str, metadata: dict[bytes, bytes]) -> None:
    """Write the events of an MCAP file as a Parquet file beside it.

    Args:
        messages: MCAP file with an end.
        topic: of the events.
        metadata: of the file.

    Raises:
        ValueError: an event is of another version.
        OSError: a file cannot be read or written.
    """
    path = messages.with_name(EVENTS)
    draft = path.with_name(f"{path.name}.new")
    schema = EVENTS_SCHEMA.with_metadata(metadata)
    rows = [
        {
            **msgspec.structs.asdict(event),
            "time_utc": event.time_ns,
            "values_json": msgspec.json.encode(event.values).decode(),
        }
        for event in _events(messages, topic)
    ]
    columns = {name: [row[name] for row in rows] for name in schema.names}
    with parquet(draft, schema) as file:
        file.write_table(pa.table(columns, schema=schema))
    replace(draft, path)


def _events(messages: Path, topic: str) -> Iterator[_Event]:
    """Yield each event once: the service may send one twice."""
    seen: set[str] = set()
    with messages.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages([topic], log_time_order=False):
            event = _DECODER.decode(message.data)
            if event.id not in seen:
                seen.add(event.id)
                yield event
