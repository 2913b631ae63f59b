"""A patient's profile: a TOML file with a random id, written by the therapist.

It holds no name and no birth date: the therapist keeps the list of ids elsewhere. Nothing has a
default. The service enforces its own limits and the released plan; the range here lets a mistake be
found when the file is read, and not while a patient trains.
"""

import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec
from gaitd_toml import ConfigError, Document, decoded, parse_toml, read_toml
from msgspec import Meta

PROFILE_VERSION: Final = 1
ID_ALPHABET: Final = "abcdefghjkmnpqrstuvwxyz23456789"
"""Without characters that are easily confused when read aloud."""
ID_LENGTH: Final = 8
BLOCK_MIN_S: Final = 5.0

CADENCE_MAX_HZ: Final = 2.0
BLOCKS_MAX: Final = 50

Cadence = Annotated[float, Meta(ge=0.01, le=CADENCE_MAX_HZ)]
Share = Annotated[float, Meta(ge=0, le=1)]
PositiveShare = Annotated[float, Meta(ge=0.001, le=1)]


class _Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file: unknown and missing keys are refused."""


class Range(_Strict, frozen=True, kw_only=True):
    """The gaits that the therapist allows."""

    cadence_min_hz: Cadence
    """Slowest gait of a block."""
    cadence_max_hz: Cadence
    """Fastest gait of a block; at most that of the trainer file."""
    amplitude_min_ratio: PositiveShare
    """Smallest amplitude of a block, as a ratio of the configured gait."""
    amplitude_max_ratio: PositiveShare
    """Largest amplitude of a block, as a ratio of the configured gait."""


class HipCap(_Strict, frozen=True, kw_only=True):
    """Cap of a controller's assist of the hip."""

    max_nm: Annotated[float, Meta(ge=0, le=120)]
    """Largest assist; 0: none. At most that of `limits.toml`."""


class SlideCap(_Strict, frozen=True, kw_only=True):
    """Cap of a controller's assist of the slide."""

    max_n: Annotated[float, Meta(ge=0, le=1500)]
    """Largest assist; 0: none. At most that of `limits.toml`."""


class AssistCap(_Strict, frozen=True, kw_only=True):
    """Cap of a controller's assist; it is part of the released plan, which the core enforces."""

    hip: HipCap
    slide: SlideCap


class Goal(_Strict, frozen=True, kw_only=True):
    """How the target band moves; see `goals.py`. Shares are those of `Stride.share_ratio`."""

    share_min_ratio: Share
    """The middle of the band is never lower."""
    share_max_ratio: Share
    """The middle of the band is never higher."""
    share_start_ratio: Share
    """The middle of the band in the first block of the first session."""
    band_width_ratio: PositiveShare
    """Width of the band. Narrower is harder; below the noise of the share it cannot be met."""
    challenge_ratio: Share
    """The band is led to so much above what the patient did."""
    step_max_ratio: Share
    """The band moves by at most so much from a block to the next; the first one proposes it."""
    in_band_goal_ratio: PositiveShare
    """The goal of a block: so many of its valid strides within the band."""


class Walk(_Strict, frozen=True, kw_only=True):
    """A gait without interruption, and the pause after it."""

    duration_s: Annotated[float, Meta(ge=BLOCK_MIN_S, le=3600)]
    """Duration of the gait."""
    cadence_hz: Cadence
    """Strides per second, within `[range]`."""
    amplitude_ratio: PositiveShare
    """Amplitude as a ratio of the configured gait, within `[range]`."""
    rest_s: Annotated[float, Meta(ge=0, le=3600)]
    """The next block cannot be started earlier."""


class Plan(_Strict, frozen=True, kw_only=True):
    """A session: the passive minute, the warm-up, then the blocks in this order."""

    passive: Walk | None = None
    """A gait in which the patient relaxes, 80 s for a minute of strides; None: there is none."""
    warm_up: Walk
    block: Annotated[tuple[Walk, ...], Meta(min_length=1, max_length=BLOCKS_MAX)]
    """Blocks in their order; `[[plan.block]]` for each."""


class Profile(_Strict, frozen=True, kw_only=True):
    """One patient on one trainer."""

    version: Annotated[int, Meta(ge=PROFILE_VERSION, le=PROFILE_VERSION)]
    """Version of this file's form."""
    id: Annotated[str, Meta(pattern=rf"^[{ID_ALPHABET}]{{{ID_LENGTH}}}$")]
    """Random; `gaitd-session new-profile` draws one."""
    legs: Annotated[tuple[Annotated[str, Meta(pattern="^(left|right)$")], ...], Meta(min_length=1)]
    """Legs that are trained, as in the trainer file."""
    range: Range
    assist: AssistCap
    goal: Goal
    plan: Plan


def new_id() -> str:
    """Draw an id; 31^8 are possible."""
    return "".join(secrets.choice(ID_ALPHABET) for _ in range(ID_LENGTH))


def read_profile(file: Path) -> Profile:
    """Read a profile.

    Raises:
        ConfigError: the file cannot be read, has a wrong, unknown or missing key, or a value that
            contradicts another one.
    """
    return _checked(read_toml(file))


def parse_profile(text: str, file: Path) -> Profile:
    """Decode the text of a profile; `file` is named in errors.

    Raises:
        ConfigError: as `read_profile`.
    """
    return _checked(parse_toml(file, text.encode()))


def _checked(document: Document) -> Profile:
    profile = decoded(document, Profile)
    wrong = contradictions(profile)
    if errors := [ConfigError(document.path, one.key, one.value, one.allowed) for one in wrong]:
        raise ConfigError.combined(errors)
    return profile


class Wrong(NamedTuple):
    """A value that is not allowed."""

    key: str
    value: object
    value_low: float | None
    """The least that is allowed; None: the value is no number."""
    value_high: float | None
    allowed: str
    """What is allowed, in English, for the error of a file."""


def contradictions(profile: Profile) -> list[Wrong]:
    """Return the values that are allowed alone, and not beside another one."""
    return [*_of_bounds(profile), *_of_walks(profile)]


def _of_bounds(profile: Profile) -> Iterator[Wrong]:
    limits, goal = profile.range, profile.goal
    if len(set(profile.legs)) != len(profile.legs):
        yield Wrong("legs", profile.legs, None, None, "each leg once")
    for name, low, high, most in (
        ("range.cadence_max_hz", limits.cadence_min_hz, limits.cadence_max_hz, CADENCE_MAX_HZ),
        ("range.amplitude_max_ratio", limits.amplitude_min_ratio, limits.amplitude_max_ratio, 1.0),
        ("goal.share_max_ratio", goal.share_min_ratio, goal.share_max_ratio, 1.0),
    ):
        if high < low:
            allowed = f"at least {name.replace('max', 'min')}, which is {low:g}"
            yield Wrong(name, high, low, most, allowed)
    low, high, start = goal.share_min_ratio, goal.share_max_ratio, goal.share_start_ratio
    if not low <= start <= high:
        allowed = f"from {low:g} to {high:g}, the therapist's bounds"
        yield Wrong("goal.share_start_ratio", start, low, high, allowed)


def _of_walks(profile: Profile) -> Iterator[Wrong]:
    limits, plan = profile.range, profile.plan
    walks = {} if plan.passive is None else {"plan.passive": plan.passive}
    walks |= {"plan.warm_up": plan.warm_up}
    walks |= {f"plan.block[{index}]": walk for index, walk in enumerate(plan.block)}
    bounds = {
        "cadence_hz": (limits.cadence_min_hz, limits.cadence_max_hz),
        "amplitude_ratio": (limits.amplitude_min_ratio, limits.amplitude_max_ratio),
    }
    for key, walk in walks.items():
        for name, (low, high) in bounds.items():
            value = getattr(walk, name)
            if not low <= value <= high:
                allowed = f"from {low:g} to {high:g}, the profile's range"
                yield Wrong(f"{key}.{name}", value, low, high, allowed)
