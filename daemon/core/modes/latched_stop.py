"""Latched verdict in the state file: kept across restarts until a reset.

    mode                            verdict in the state file
    ----------------------------    ------------------------------------------------------
    off, bringing up                unchanged
    hold, gait, ... (enabled)       LAST_END_UNKNOWN, or the one already there
    stopping, by a verdict          that verdict, from its first cycle
    stopping, by a request          unchanged: the run has not ended yet
    fault                           that verdict; none after an orderly shutdown
    ready                           none

A new core brings its drives up as usual, and is then in FAULT with the noted verdict until a reset
is requested. The page in memory is written in the cycle that stops, so it survives the end of the
process. After a power cut an older page may be found; it was written while drives were enabled and
contains LAST_END_UNKNOWN.
"""

import math
from typing import Final

from gaitd_names import Cause, Finding, Mode, StopCategory
from msgspec.structs import replace

from daemon.core.modes.persistent_state import StoredVerdict
from daemon.ipc.record import Verdict, clipped

SAID_BYTES_MAX: Final = 120
_NOT_LATCHED: Final = frozenset({Cause.NONE, Cause.SHUTDOWN, Cause.DRIVE_POWERED})
"""Causes that are not kept across a restart.

DRIVE_POWERED is not kept because the next bring-up finds a drive that holds the leg again.
"""

_CATEGORIES: Final = {str(category): category for category in StopCategory}
_CAUSES: Final = {str(cause): cause for cause in Cause}
_FINDINGS: Final = {str(finding): finding for finding in Finding}


def updated(
    stored: StoredVerdict | None, mode: Mode, verdict: Verdict, utc_ns: int
) -> StoredVerdict | None:
    """The latched verdict that a new core should find if this one ended now."""
    if mode.active:
        return stored if stored is not None else _running(utc_ns)
    if mode == Mode.READY:
        return None
    if mode not in {Mode.STOPPING, Mode.FAULT}:
        return stored
    if verdict.cause not in _NOT_LATCHED:
        return _stored_verdict(verdict, stored, utc_ns)
    ended = mode == Mode.FAULT and verdict.cause == Cause.SHUTDOWN
    return None if ended else stored


def _running(utc_ns: int) -> StoredVerdict:
    finding = Finding.ENDED_WHILE_ENABLED
    unknown = Verdict(StopCategory.S1, Cause.LAST_END_UNKNOWN, finding=finding)
    return _stored_verdict(unknown, None, utc_ns)


def _stored_verdict(verdict: Verdict, stored: StoredVerdict | None, utc_ns: int) -> StoredVerdict:
    """The note of a verdict; an equal existing note is kept with its time."""
    new = StoredVerdict(
        category=verdict.category,
        cause=verdict.cause,
        drive=verdict.drive,
        value=verdict.value if math.isfinite(verdict.value) else None,
        limit=verdict.limit if math.isfinite(verdict.limit) else None,
        finding=verdict.finding,
        said=clipped(verdict.said, SAID_BYTES_MAX),
        utc_ns=utc_ns,
    )
    same = stored is not None and replace(new, utc_ns=stored.utc_ns) == stored
    return stored if stored is not None and same else new


def verdict_of(stored: StoredVerdict) -> Verdict:
    """The verdict of a note in the state file.

    An unknown cause, from another version, becomes LAST_END_UNKNOWN, an unknown category S1.
    """
    category = _CATEGORIES.get(stored.category, StopCategory.S1)
    cause = _CAUSES.get(stored.cause)
    if cause is None:
        other = Finding.NOTES_OF_OTHER_VERSION
        unknown = Cause.LAST_END_UNKNOWN
        return Verdict(category, unknown, stored.drive, finding=other, said=stored.cause)
    value, limit = stored.value or 0.0, stored.limit or 0.0
    finding = _FINDINGS.get(stored.finding, Finding.NONE)
    return Verdict(category, cause, stored.drive, value, limit, finding, stored.said)
