"""What the therapist's page shows of a patient's training: profile, plan, and the sessions.

Profile and history are those of the patient's server, which writes the history; here they are
only read. A file that is missing or cannot be read is told on the page.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import Final

import msgspec
from gaitd_client import PlanLimits
from gaitd_session import (
    BlockKind,
    GoalSummary,
    SessionSummary,
    Store,
    StoreError,
    blocks_of,
    limits_of,
    read_profile,
)
from gaitd_session.goals import band_about
from gaitd_session.profile import Goal
from gaitd_session.profile import Profile as SessionProfile
from gaitd_session.store import InterruptionRow, MarkRow
from gaitd_texts import STOPS
from gaitd_toml import ConfigError

from gaitd_display.settings import SessionFiles
from gaitd_display.words import Spoken, spoken

NS_PER_MS: Final = 1_000_000
SESSIONS_MAX: Final = 200
"""The newest of so many are shown."""
STOPS_MAX: Final = 5
"""The newest of so many are shown of each session."""
MARKS_MAX: Final = 20
"""The newest of so many are shown of each session."""


class PlannedBlock(msgspec.Struct, frozen=True):
    """One block of the plan, and the least rest after it."""

    kind: BlockKind
    duration_s: float
    cadence_hz: float
    amplitude_ratio: float
    rest_s: float


class Target(msgspec.Struct, frozen=True):
    """A target band of the patient's share."""

    low_ratio: float
    high_ratio: float


class Profile(msgspec.Struct, frozen=True):
    """The profile, as far as a therapist reviews it here."""

    id: str
    share_min_ratio: float
    share_max_ratio: float
    blocks: tuple[PlannedBlock, ...]
    limits: PlanLimits
    """What an operator releases for this plan."""


class PastStop(msgspec.Struct, frozen=True):
    """What has interrupted a session."""

    time_ms: float
    """UTC, ms since 1970."""
    said: Spoken
    remedy: Spoken | None
    """What to do about it, and whom to call; None: nothing, a patient has paused for example."""


class PastMark(msgspec.Struct, frozen=True):
    """What a person has written about a session."""

    time_ms: float
    """UTC, ms since 1970."""
    text: str


class PastSession(msgspec.Struct, frozen=True):
    """One session of the history."""

    begun_ms: float
    """UTC, ms since 1970."""
    end: str
    """complete, ended, left, interrupted; empty: it goes on."""
    walked_s: float
    valid_count: int
    reached_count: int
    """Valid strides at or above the lower end of their target band."""
    mean_share_ratio: float | None
    """Mean over the valid strides; None: there is none."""
    target: Target | None
    """Mean of the bands of its blocks and legs; None: there is none."""
    interruption_count: int
    stops: tuple[PastStop, ...]
    """The newest first."""
    marks: tuple[PastMark, ...]
    """The newest first."""
    block: int
    """Number of its newest block, from 1; 0: none was begun."""


class Progress(msgspec.Struct, frozen=True):
    """Answer to a page that asks for it."""

    is_configured: bool
    """False: the file of the server has no table `session`."""
    profile: Profile | None = None
    sessions: tuple[PastSession, ...] = ()
    """Oldest first."""
    targets: dict[str, Target] = {}
    """The present target band, by leg."""
    self_test_ms: float | None = None
    """When a self-test was passed; None: not known, 0: never."""
    troubles: tuple[Spoken, ...] = ()
    """What could not be read: file, reason, what to do."""


class _History(msgspec.Struct, frozen=True):
    """What is read of the history."""

    sessions: Sequence[SessionSummary] = ()
    """The newest `SESSIONS_MAX`."""
    stops: Mapping[int, Sequence[InterruptionRow]] = {}
    """What has interrupted each of these sessions, by its number."""
    marks: Mapping[int, Sequence[MarkRow]] = {}
    """Those of each session that has any."""
    goals: Sequence[GoalSummary] = ()
    self_test_ms: float | None = None
    troubles: tuple[Spoken, ...] = ()


def read_progress(files: SessionFiles | None) -> Progress:
    """Read both files; call it in a thread, because a disk may take a second."""
    if files is None:
        return Progress(is_configured=False)
    try:
        profile = read_profile(files.profile)
    except ConfigError as error:
        troubles = (_trouble("profile", one)[0] for one in (error, *error.more))
        return Progress(is_configured=True, troubles=tuple(troubles))
    history = _read_history(files, profile)
    goals: dict[int, list[GoalSummary]] = defaultdict(list)
    for goal in history.goals:
        goals[goal.session].append(goal)
    return Progress(
        is_configured=True,
        profile=_profile(profile),
        sessions=tuple(
            _session(one, history, goals[one.number], profile.goal) for one in history.sessions
        ),
        targets=present_targets(profile, history.goals),
        self_test_ms=history.self_test_ms,
        troubles=history.troubles,
    )


def _read_history(files: SessionFiles, profile: SessionProfile) -> _History:
    try:
        if not files.history.exists():
            return _History(troubles=_trouble("no_history", files.history))
        with Store(files.history, is_writer=False) as store:
            sessions = store.summaries(profile.id)[-SESSIONS_MAX:]
            return _History(
                sessions,
                {one.number: store.interruptions(one.number)[-STOPS_MAX:] for one in sessions},
                store.marks(profile.id),
                store.goals(profile.id, profile.goal.band_width_ratio / 2),
                store.self_test_utc_ns(profile.id) / NS_PER_MS,
            )
    except StoreError as error:
        return _History(troubles=_trouble("history", error))
    except OSError as error:
        return _History(troubles=_trouble("no_right", error))


def _trouble(key: str, what: object) -> tuple[Spoken]:
    """Return what could not be read; `what` is the file, or what was said about it."""
    return (spoken(lambda texts: texts.text(f"trouble.{key}", said=str(what))),)


def _profile(profile: SessionProfile) -> Profile:
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
    goal = profile.goal
    return Profile(
        profile.id, goal.share_min_ratio, goal.share_max_ratio, tuple(blocks), limits_of(profile)
    )


def present_targets(profile: SessionProfile, goals: Sequence[GoalSummary]) -> dict[str, Target]:
    """Return the band of each leg now.

    It is that of the newest block while this goes on, then the one that follows from it; before
    the first session it is that of the profile.

    Args:
        profile: of the patient.
        goals: of all sessions, oldest first.
    """
    middles = dict.fromkeys(profile.legs, profile.goal.share_start_ratio)
    for goal in goals:
        if goal.leg in middles:
            middles[goal.leg] = goal.middle_ratio if goal.goes_on else goal.next_middle_ratio
    return {leg: _target(middle, profile.goal) for leg, middle in middles.items()}


def _target(middle_ratio: float, goal: Goal) -> Target:
    band = band_about(middle_ratio, goal)
    return Target(band.low_ratio, band.high_ratio)


def _session(
    one: SessionSummary,
    history: _History,
    goals: Sequence[GoalSummary],
    goal: Goal,
) -> PastSession:
    return PastSession(
        one.begun_utc_ns / NS_PER_MS,
        one.end,
        one.walked_s,
        one.valid_count,
        sum(one.reached_count for one in goals),
        one.mean_share_ratio,
        _target(fmean(one.middle_ratio for one in goals), goal) if goals else None,
        one.interruption_count,
        tuple(_stop(stop) for stop in reversed(history.stops[one.number])),
        tuple(
            PastMark(mark.utc_ns / NS_PER_MS, mark.said)
            for mark in reversed(history.marks.get(one.number, ())[-MARKS_MAX:])
        ),
        max((one.block for one in goals), default=0),
    )


def _stop(row: InterruptionRow) -> PastStop:
    code = row.reason or row.phase
    remedy = spoken(lambda texts: texts.remedy(code, texts.buttons())) if code in STOPS else None
    return PastStop(row.utc_ns / NS_PER_MS, interruption(code), remedy)


def interruption(code: str) -> Spoken:
    """Return why an interruption was, for the operator.

    Args:
        code: of the history: a cause of a stop, a `Why`, a phase, a failure, a code of a refusal.
    """
    return spoken(lambda texts: texts.interruption(code))
