"""A latched verdict across restarts: what is noted of it in each mode, and what becomes of it.

    mode                            noted is
    ----------------------------    ------------------------------------------------------
    off, bringing up                what was
    hold, gait, ... (enabled)       LAST_END_UNKNOWN: whoever finds it finds a run that nobody ended
    stopping, by a verdict          that verdict, from its first cycle
    stopping, as asked              what was: it has not ended yet
    fault                           that verdict; nothing after an orderly shutdown
    ready                           nothing

A new core brings its drives up as always, and is then in FAULT with what was noted, as long as it
takes until somebody asks for a reset. The page is written in the cycle that stops, so it survives
the death of the process at once; after a power cut an older page is found, which is of a time when
drives were enabled, and says that nobody knows.
"""

import math
from datetime import UTC, datetime
from typing import Final

from msgspec.structs import replace

from daemon.core.modes.persistent_state import LatchedNote
from daemon.core.state import Core
from daemon.core.steps.transition import describe
from daemon.ipc.record import Cause, Mode, StopCategory, Verdict, clipped

DETAIL_BYTES_MAX: Final = 120
_NOT_LATCHED: Final = frozenset({Cause.NONE, Cause.SHUTDOWN, Cause.DRIVE_POWERED})
"""No stops, or none that a new start should remember: a drive that holds the leg is seen again."""


def follow(core: Core, utc_ns: int) -> None:
    """Note what a new core should know, if this one ended now."""
    noted = core.notes.latched
    wanted = _wanted(core, noted, utc_ns)
    if wanted is not noted:
        core.notes = replace(core.notes, latched=wanted)


def _wanted(core: Core, noted: LatchedNote | None, utc_ns: int) -> LatchedNote | None:
    if core.mode.active:
        return noted if noted is not None else _running(utc_ns)
    if core.mode == Mode.READY:
        return None
    if core.mode not in {Mode.STOPPING, Mode.FAULT}:
        return noted
    if core.verdict.cause not in _NOT_LATCHED:
        return _note(core.verdict, noted, utc_ns)
    ended = core.mode == Mode.FAULT and core.verdict.cause == Cause.SHUTDOWN
    return None if ended else noted


def _running(utc_ns: int) -> LatchedNote:
    unknown = Verdict(
        StopCategory.S1, Cause.LAST_END_UNKNOWN, detail="it ended while drives were enabled"
    )
    return _note(unknown, None, utc_ns)


def _note(verdict: Verdict, noted: LatchedNote | None, utc_ns: int) -> LatchedNote:
    """The note of a verdict; the one that is there already if it says the same."""
    note = LatchedNote(
        category=verdict.category.name,
        cause=verdict.cause.name,
        drive=verdict.drive,
        value=verdict.value if math.isfinite(verdict.value) else None,
        limit=verdict.limit if math.isfinite(verdict.limit) else None,
        detail=clipped(verdict.detail, DETAIL_BYTES_MAX),
        utc_ns=utc_ns,
    )
    same = noted is not None and replace(note, utc_ns=noted.utc_ns) == noted
    return noted if noted is not None and same else note


def verdict_of(noted: LatchedNote | None) -> Verdict | None:
    """The verdict that was noted; None if there was none.

    A cause or a category that is not known here, from another version, is none to forget.
    """
    if noted is None:
        return None
    category = StopCategory.__members__.get(noted.category, StopCategory.S1)
    cause = Cause.__members__.get(noted.cause)
    if cause is None:
        said = f"{noted.cause}, which is of another version"
        return Verdict(category, Cause.LAST_END_UNKNOWN, noted.drive, detail=said)
    value, limit = noted.value or 0.0, noted.limit or 0.0
    return Verdict(category, cause, noted.drive, value, limit, noted.detail)


def take_over(core: Core) -> bool:
    """After a restart: what is still latched is in force again; whether there is anything."""
    noted = core.notes.latched
    verdict = verdict_of(noted)
    if noted is None or verdict is None:
        return False
    core.verdict = verdict
    core.causes_told = {(verdict.cause, verdict.drive)}
    core.events.append(f"latched since {_said(noted.utc_ns)}: {describe(verdict)}")
    return True


def clear(core: Core) -> None:
    """Somebody asked for a reset."""
    if core.notes.latched is not None:
        core.notes = replace(core.notes, latched=None)


def _said(utc_ns: int) -> str:
    if utc_ns == 0:
        return "before this start"
    return f"{datetime.fromtimestamp(utc_ns * 1e-9, UTC):%Y-%m-%d %H:%M:%S} UTC"
