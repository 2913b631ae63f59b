"""Writes lines with fields to systemd's journal by its native protocol, without ever blocking.

    journalctl -t gaitd-core GAITD_CAUSE=drive_silent -o json

An entry is one datagram. A field is `NAME=value` and a line break; a value with line breaks is the
name alone, then its length as 64 bits little-endian, then the value (systemd.io, "Native Journal
Protocol"). Libraries for it block while the journal is busy, which the 10 ms cycle must not; here
an entry that finds no room is dropped and counted, and the next one carries the count.

Fields of ours (docs/running.md): GAITD_EVENT, GAITD_MODE, GAITD_CAUSE, GAITD_DRIVE, GAITD_CYCLE.
"""

import contextlib
import os
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Final

SOCKET: Final = Path("/run/systemd/journal/socket")
STDERR: Final = 2
LENGTH_MAX: Final = 64 * 1024
"""Maximum size of one value in bytes, which fits a datagram of the journal; the rest is cut off."""


def is_journal(journal_stream: str | None, file_descriptor: int) -> bool:
    """True if this descriptor leads to the journal: JOURNAL_STREAM names its device and inode."""
    device, _, inode = (journal_stream or "").partition(":")
    try:
        status = os.fstat(file_descriptor)
        return (status.st_dev, status.st_ino) == (int(device), int(inode))
    except (OSError, ValueError):
        return False


def to_stderr(text: str) -> None:
    """Write a line to standard error; one that is full or closed does not affect the program.

    Python's own buffer would keep what cannot be written, and end the program with 120.
    """
    with contextlib.suppress(OSError):
        os.write(STDERR, f"{text}\n".encode(errors="backslashreplace"))


def encoded(fields: Mapping[str, str]) -> bytes:
    """All fields of one entry in the journal's native format."""
    return b"".join(_field(name, value) for name, value in fields.items())


def _field(name: str, value: str) -> bytes:
    data = value.encode(errors="replace")[:LENGTH_MAX]
    if b"\n" in data:
        return name.encode() + b"\n" + len(data).to_bytes(8, "little") + data + b"\n"
    return name.encode() + b"=" + data + b"\n"


class Journal:
    """Writer of journal entries; without a journal it does nothing."""

    def __init__(self, identifier: str, path: Path | None) -> None:
        """`identifier` is SYSLOG_IDENTIFIER; `path` is the socket's, None if there is no journal.

        The address is sent with each line, so that a restarted journal gets the next one.
        """
        self._identifier = identifier
        self._path = str(path) if path is not None else None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)
        self._unreported_count = 0
        self.dropped_count = 0
        """Lines that the journal had no room for, or was not running for."""

    @property
    def is_open(self) -> bool:
        """True if there is a journal to write to."""
        return self._path is not None

    def write(self, text: str, priority: int, fields: Mapping[str, str]) -> None:
        """Write one entry; never waits.

        Args:
            text: the message.
            priority: of syslog(3): 3 error, 4 warning, 5 notice, 6 informational.
            fields: by their names in the journal: capital letters, digits and underscores.
        """
        if self._path is None:
            return
        entry = {
            "MESSAGE": text,
            "PRIORITY": str(priority),
            "SYSLOG_IDENTIFIER": self._identifier,
            **fields,
        }
        if self._unreported_count:
            entry["GAITD_DROPPED"] = str(self._unreported_count)
        try:
            self._socket.sendto(encoded(entry), self._path)
        except OSError:
            self.dropped_count += 1
            self._unreported_count += 1
        else:
            self._unreported_count = 0

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
