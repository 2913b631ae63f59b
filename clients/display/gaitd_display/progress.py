"""What the therapist's page shows of a patient's training: profile, plan, and the sessions.

Profile and history are those of the patient's server, which writes the history; here they are
only read. A file that is missing or cannot be read is told on the page.
"""

from typing import Final

import msgspec
from gaitd_client import PlanLimits
from gaitd_session import (
    BlockKind,
    ProfileError,
    SessionSummary,
    Store,
    StoreError,
    blocks_of,
    limits_of,
    read_profile,
)

from gaitd_display.settings import SessionFiles

NS_PER_MS: Final = 1_000_000
SESSIONS_MAX: Final = 200
"""The newest of so many are shown."""


class PlannedBlock(msgspec.Struct, frozen=True):
    """One block of the plan, and the least rest after it."""

    kind: BlockKind
    duration_s: float
    cadence_hz: float
    amplitude_ratio: float
    rest_s: float


class Profile(msgspec.Struct, frozen=True):
    """The profile, as far as a therapist reviews it here."""

    id: str
    legs: tuple[str, ...]
    share_min_ratio: float
    share_max_ratio: float
    blocks: tuple[PlannedBlock, ...]
    limits: PlanLimits
    """What an operator releases for this plan."""


class PastSession(msgspec.Struct, frozen=True):
    """One session of the history."""

    begun_ms: float
    """UTC, ms since 1970."""
    end: str
    """complete, ended, left, interrupted; empty: it goes on."""
    walked_s: float
    stride_count: int
    valid_count: int
    mean_share_ratio: float | None
    """Mean over the valid strides; None: there is none."""
    interruption_count: int
    last_interruption: str
    """Its reason, English, or its phase; empty: there is none."""


class Progress(msgspec.Struct, frozen=True):
    """Answer to a page that asks for it."""

    is_configured: bool
    """False: the file of the server has no table `session`."""
    profile: Profile | None = None
    sessions: tuple[PastSession, ...] = ()
    """Oldest first."""
    troubles: tuple[str, ...] = ()
    """What could not be read: file, reason, what to do."""


def read_progress(files: SessionFiles | None) -> Progress:
    """Read both files; call it in a thread, because a disk may take a second."""
    if files is None:
        return Progress(is_configured=False)
    try:
        profile = read_profile(files.profile)
    except ProfileError as error:
        return Progress(is_configured=True, troubles=(str(error),))
    troubles: tuple[str, ...] = ()
    summaries: list[SessionSummary] = []
    try:
        if files.history.exists():
            with Store(files.history, is_writer=False) as store:
                summaries = store.summaries(profile.id)
        else:
            troubles = (f"{files.history}: there is no history yet",)
    except StoreError as error:
        troubles = (str(error),)
    except OSError as error:
        reason = error.strerror or "cannot be read"
        troubles = (f"{files.history}: {reason}; give this server's user the right to read it",)
    goal = profile.goal
    blocks = (
        PlannedBlock(
            block.kind,
            block.walk.duration_s,
            block.walk.cadence_hz,
            block.walk.amplitude_ratio,
            block.walk.rest_s,
        )
        for block in blocks_of(profile)
    )
    return Progress(
        is_configured=True,
        profile=Profile(
            profile.id,
            profile.legs,
            goal.share_min_ratio,
            goal.share_max_ratio,
            tuple(blocks),
            limits_of(profile),
        ),
        sessions=tuple(map(_session, summaries[-SESSIONS_MAX:])),
        troubles=troubles,
    )


def _session(one: SessionSummary) -> PastSession:
    return PastSession(
        one.begun_utc_ns / NS_PER_MS,
        one.end,
        one.walked_s,
        one.stride_count,
        one.valid_count,
        one.mean_share_ratio,
        one.interruption_count,
        one.last_interruption,
    )
