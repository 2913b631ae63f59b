"""One recording while it is made: a folder `NAME.part`, which becomes `NAME` at its end.

    messages.mcap             every message but `estimate`: JSON, with its schema; chunks with zstd
    LEG.arrows                estimates of a leg; two Parquet files at the end (`leg_table.py`)

`sync` brings all to the disk: what was added before it survives a kill and a power cut. The folder
is locked while it is made, so that no other recorder finishes it.
"""

import fcntl
import os
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from gaitd_client import wire
from mcap.writer import Writer

from gaitd_record.about import CONFIGURATION, END_NAME, NAME, About, Head, Journal
from gaitd_record.disk import sync_folder
from gaitd_record.errors import RecordError
from gaitd_record.event_table import check_event
from gaitd_record.leg_table import STREAM, LegStream

MESSAGES: Final = "messages.mcap"
PART: Final = ".part"
CHUNK_BYTES: Final = 1 << 20
JSON: Final = "json"
TOPIC: Final = "/"
"""Before a key: viewers know topics with it."""
SEQUENCE_MAX: Final = 2**32
"""MCAP numbers messages by 32 bits."""
ESTIMATE: Final = "estimate"
IN_ORDER: Final = "in order"
_SCHEMAS: Final = {wire.schema_name(kind): kind for kind in wire.MESSAGES.values()}


class Received(NamedTuple):
    """A message as it came."""

    key: str
    """Below TRAINER."""
    schema: str
    """`gaitd.NAME.vN`; empty: unknown."""
    payload: bytes
    """JSON, kept as it is."""
    utc_ns: int
    """Time of receipt, by the clock of this computer."""


class Recording:
    """Takes the messages of one run of a core."""

    def __init__(self, path: Path, about: About) -> None:
        """Create the folder.

        Args:
            path: of the finished recording.
            about: what it says of itself.

        Raises:
            RecordError: there is a recording of this name.
            OSError: it cannot be written.
        """
        self.path, self.part = path, path.with_name(path.name + PART)
        if path.exists():
            raise RecordError(f"{path}: is there already; recordings are not replaced")
        self.about, self.journal = about, Journal()
        try:
            self.part.mkdir(parents=True)
        except FileExistsError as error:
            raise RecordError(f"{self.part}: is there already, unfinished") from error
        self._file = (self.part / MESSAGES).open("xb")
        fcntl.flock(self._file, fcntl.LOCK_EX)
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="", library=f"gaitd-record {about.recorder_version}")
        begun_ns = about.begun_utc_ns
        self._writer.add_attachment(
            begun_ns, begun_ns, CONFIGURATION, "application/json", about.configuration()
        )
        self._writer.add_metadata(NAME, about.metadata())
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}
        self._legs: dict[str, LegStream] = {}
        self._has_new_names = True
        self.sync()
        sync_folder(self.part.parent)

    def add(self, received: Received, head: Head) -> None:
        """Take a message; its log time is that of its receipt, its publish time the trainer's.

        Args:
            received: the message.
            head: of the message.

        Raises:
            ValueError: it is none of gaitd's.
            OSError: it cannot be written.
        """
        key, schema, payload, log_ns = received
        leg, _, name = key.partition("/")
        if name == ESTIMATE and schema == wire.schema_name(wire.Estimate):
            if leg not in self.about.leg_names:
                raise ValueError(f"leg {leg!r}: the trainer has {', '.join(self.about.leg_names)}")
            if leg not in self._legs:
                self._legs[leg] = LegStream(self.part / f"{leg}{STREAM}")
                self._has_new_names = True
            self._legs[leg].add(payload)
            self.journal.add(key, head)
            return
        if key == wire.SAFETY:
            self.journal.add_safety(payload)
        if key == wire.EVENTS:
            check_event(payload)
        self.journal.add(key, head)
        # A message without a record of a core has the time of the newest that has one.
        utc_ns = head.sample_time_ns or self.journal.end_utc_ns or self.about.begun_utc_ns
        self._writer.add_message(
            self._channel(key, schema), log_ns, payload, utc_ns, head.seq % SEQUENCE_MAX
        )

    def _channel(self, key: str, schema: str) -> int:
        if (key, schema) not in self._channels:
            if schema not in self._schemas and schema in _SCHEMAS:
                text = msgspec.json.encode(_for_viewers(wire.schema(_SCHEMAS[schema])))
                self._schemas[schema] = self._writer.register_schema(schema, "jsonschema", text)
            self._channels[key, schema] = self._writer.register_channel(
                TOPIC + key, JSON, self._schemas.get(schema, 0)
            )
        return self._channels[key, schema]

    def sync(self) -> None:
        """Bring all messages to the disk.

        Raises:
            OSError: they cannot be written.
        """
        self._writer.flush()
        os.fdatasync(self._file.fileno())
        for leg in self._legs.values():
            leg.sync()
        if self._has_new_names:
            sync_folder(self.part)
            self._has_new_names = False

    def close(self, ended: str = IN_ORDER) -> None:
        """Write the ends of the files; `finish` makes the recording of the folder.

        Args:
            ended: why it ended, for readers.

        Raises:
            OSError: they cannot be written.
        """
        try:
            for leg in self._legs.values():
                leg.close()
            self._writer.add_metadata(END_NAME, self.journal.metadata(ended))
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
        finally:
            self._file.close()


def _for_viewers(schema: dict[str, Any]) -> dict[str, Any]:
    """Return a schema in which each field has one type.

    Lichtblick and Foxglove show no message of a schema with `anyOf` or `$ref`. They accept null for
    a field of any type.
    """
    definitions: dict[str, Any] = schema.get("$defs", {})

    def plain(node: dict[str, Any]) -> dict[str, Any]:
        node = dict(node)
        for one in node.pop("anyOf", ()):
            if one != {"type": "null"}:
                node = {**one, **node}
        if "$ref" in node:
            node = {**definitions[node.pop("$ref").rpartition("/")[2]], **node}
            return plain(node)
        if "items" in node:
            node["items"] = plain(node["items"])
        if "properties" in node:
            node["properties"] = {name: plain(one) for name, one in node["properties"].items()}
        return node

    return plain({name: one for name, one in schema.items() if name != "$defs"})
