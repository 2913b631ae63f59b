"""The hash chain of the request log: each line holds the SHA-256 of the line before it.

All functions here are pure; no file is touched.

A line is one JSON object. Its `n` counts up by one. Its `before` is the SHA-256 of the line before
it, byte for byte without the newline; the first line of all has 64 zeros. Its `own`, at its end, is
the SHA-256 of the line without that field. So a changed, removed, added or moved line is detected.
Not detected is that the newest lines were cut off, or that all hashes were computed anew from some
line on: against that, note the hash of the last line elsewhere.

A power cut may leave the last line torn. The next gateway ends it with a newline and goes on with a
line of the kind `repaired`, whose `before` is the hash of the torn line as it is.
"""

import hashlib
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import msgspec

from daemon.ipc.decoding import INTEGER_MAX, Decoder, RefusedError

ANYTHING: Final[Decoder[Any]] = Decoder(msgspec.json.decode)
"""Decoder of JSON of any form."""
BEGINNING: Final = "0" * 64
"""`before` of the first line of all."""
REPAIRED: Final = "repaired"


_OWN: Final = b',"own":"%s"}'
_OWN_LENGTH: Final = len(_OWN % (b"0" * 64))


class Place(NamedTuple):
    """End of a chain: number and hash of its newest line, which the next line needs."""

    n: int = 0
    """Number of the newest line; 0: there is none."""
    head: str = BEGINNING
    """SHA-256 of the newest line."""


class Break(NamedTuple):
    """A line at which a chain is broken."""

    line: int
    """Number of the line over everything that was checked, from 1."""
    reason: str


class Check(NamedTuple):
    """Result of checking a chain."""

    line_count: int
    torn_count: int
    first_n: int
    """More than 1: older lines have been removed, with their file or otherwise."""
    place: Place
    breaks: tuple[Break, ...]


def hash_of(line: bytes) -> str:
    """SHA-256 of a line without its newline."""
    return hashlib.sha256(line).hexdigest()


def sealed(place: Place, fields: dict[str, Any]) -> tuple[bytes, Place]:
    """The next line, without its newline, and the end of the chain after it."""
    n = place.n + 1
    body = msgspec.json.encode({"n": n, "before": place.head, **fields})
    line = body[:-1] + _OWN % hash_of(body).encode()
    return line, Place(n, hash_of(line))


def fields_of(line: bytes) -> dict[str, Any] | None:
    """The fields of a line; None if it is not a line of the log."""
    try:
        found = ANYTHING.decode(line)
    except RefusedError:
        return None
    if not isinstance(found, dict):
        return None
    n, before = found.get("n"), found.get("before")
    numbered = type(n) is int and 0 < n < INTEGER_MAX
    return found if numbered and isinstance(before, str) else None


def check(lines: Iterable[bytes]) -> Check:
    """Check a chain from its oldest existing line; lines without their newlines."""
    count = torn_count = first_n = 0
    head: str | None = None
    n = 0
    torn = False
    breaks: list[Break] = []
    for count, line in enumerate(lines, 1):
        fields = fields_of(line)
        if fields is None:
            # Allowed if it is torn, which the next line has to state.
            if torn:
                breaks.append(Break(count, "two consecutive lines cannot be read"))
            torn, torn_count, head = True, torn_count + 1, hash_of(line)
            continue
        reason = (
            "it was changed after it was written"
            if _changed(line)
            else _wrong(fields, head, n, torn)
        )
        if reason:
            breaks.append(Break(count, reason))
        first_n, n, head, torn = first_n or fields["n"], fields["n"], hash_of(line), False
    if torn:
        breaks.append(
            Break(
                count,
                "the last line is incomplete; the next gateway to start adds a line that states it",
            )
        )
    return Check(count, torn_count, first_n, Place(n, head or BEGINNING), tuple(breaks))


def _changed(line: bytes) -> bool:
    """True if a line differs from the one that was written."""
    body = line[:-_OWN_LENGTH] + b"}"
    return line[-_OWN_LENGTH:] != _OWN % hash_of(body).encode()


def _wrong(fields: dict[str, Any], head: str | None, n: int, torn: bool) -> str:
    """Why a line does not follow the one before it; empty if it does."""
    if torn and fields.get("kind") != REPAIRED:
        return (
            "the line before it cannot be read, and this line does not state that it was incomplete"
        )
    if head is None:
        begins = fields["n"] == 1 and fields["before"] != BEGINNING
        return "it is the first line, but refers to an earlier one" if begins else ""
    if fields["before"] != head:
        return "the line before it is not the one that it refers to"
    # It is unknown whether a torn line had taken a number.
    if fields["n"] != n + 1 and not torn:
        return f"it is number {fields['n']} and follows number {n}"
    return ""
