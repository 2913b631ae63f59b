"""A patient's profile: a TOML file with a random id, written by the therapist.

It holds no name and no birth date: the therapist keeps the list of ids elsewhere. Nothing has a
default. The service enforces its own limits and the released plan; the range here lets a mistake be
found when the file is read, and not while a patient trains.
"""

import re
import secrets
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
from gaitd_client.numbers import not_finite
from msgspec import Meta

PROFILE_VERSION: Final = 1
ID_ALPHABET: Final = "abcdefghjkmnpqrstuvwxyz23456789"
"""Without characters that are easily confused when read aloud."""
ID_LENGTH: Final = 8
BLOCK_MIN_S: Final = 5.0
RENDERED_LENGTH_MAX: Final = 60

Cadence = Annotated[float, Meta(ge=0.01, le=2)]
Share = Annotated[float, Meta(ge=0, le=1)]
PositiveShare = Annotated[float, Meta(ge=0.001, le=1)]


class ProfileError(Exception):
    """A profile cannot be used: `file`, `key` (dotted), `value`, and what is `allowed`."""

    def __init__(self, file: Path, key: str, value: object, allowed: str) -> None:
        """Make the message; without a key the whole file is meant."""
        place = f"{file}: {key} = {_rendered(value)}" if key else f"{file}"
        super().__init__(f"{place}: {allowed}; correct the profile")
        self.file, self.key, self.value, self.allowed = file, key, value, allowed


class _Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file: unknown and missing keys are refused."""


class Range(_Strict, frozen=True, kw_only=True):
    """The gaits that the therapist allows."""

    cadence_min_hz: Cadence
    cadence_max_hz: Cadence
    amplitude_min_ratio: PositiveShare
    amplitude_max_ratio: PositiveShare


class AssistCap(_Strict, frozen=True, kw_only=True):
    """Cap of a controller's assist; it is part of the released plan, which the core enforces."""

    hip_max_nm: Annotated[float, Meta(ge=0, le=120)]
    slide_max_n: Annotated[float, Meta(ge=0, le=1500)]


class Goal(_Strict, frozen=True, kw_only=True):
    """How the target band moves; see `goals.py`. Shares are those of `Stride.share_ratio`."""

    share_min_ratio: Share
    """The middle of the band is never lower."""
    share_max_ratio: Share
    """The middle of the band is never higher."""
    share_start_ratio: Share
    """The middle of the band in the first block of the first session."""
    band_width_ratio: PositiveShare
    challenge_ratio: Share
    """The band is led to so much above what the patient did."""
    step_max_ratio: Share
    """The band moves by at most so much from a block to the next; the first one proposes it."""
    in_band_goal_ratio: PositiveShare
    """The goal of a block: so many of its valid strides within the band."""


class Walk(_Strict, frozen=True, kw_only=True):
    """One gait without interruption, and the rest after it."""

    duration_s: Annotated[float, Meta(ge=BLOCK_MIN_S, le=3600)]
    cadence_hz: Cadence
    amplitude_ratio: PositiveShare
    rest_s: Annotated[float, Meta(ge=0, le=3600)]
    """The next block cannot be started earlier."""


class Plan(_Strict, frozen=True, kw_only=True):
    """A session: the warm-up, then the blocks in this order."""

    warm_up: Walk
    block: Annotated[tuple[Walk, ...], Meta(min_length=1, max_length=50)]


class Profile(_Strict, frozen=True, kw_only=True):
    """One patient on one trainer."""

    version: Annotated[int, Meta(ge=PROFILE_VERSION, le=PROFILE_VERSION)]
    id: Annotated[str, Meta(pattern=rf"^[{ID_ALPHABET}]{{{ID_LENGTH}}}$")]
    """Random; `gaitd-session new-profile` draws one."""
    legs: Annotated[tuple[Annotated[str, Meta(pattern="^(left|right)$")], ...], Meta(min_length=1)]
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
        ProfileError: the file cannot be read, has a wrong, unknown or missing key, or a value that
            contradicts another one.
    """
    try:
        text = file.read_bytes().decode()
    except OSError as error:
        reason = error.strerror or "cannot be read"
        raise ProfileError(file, "", None, f"{reason}; a readable TOML file is needed") from error
    except UnicodeDecodeError as error:
        raise ProfileError(file, "", None, f"a TOML file is UTF-8 text ({error})") from error
    return parse_profile(text, file)


def parse_profile(text: str, file: Path) -> Profile:
    """Decode the text of a profile; `file` is named in errors.

    Raises:
        ProfileError: as `read_profile`.
    """
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of an integer of thousands of digits
        raise ProfileError(file, "", None, f"TOML syntax: {error}") from error
    for key, value in not_finite(table):
        raise ProfileError(file, key, value, "a finite number")
    try:
        profile = msgspec.convert(table, Profile)
    except msgspec.ValidationError as error:
        raise _refused(file, table, str(error)) from error
    for key, value, allowed in _contradictions(profile):
        raise ProfileError(file, key, value, allowed)
    return profile


def _refused(file: Path, table: dict[str, Any], message: str) -> ProfileError:
    """Make the error from that of msgspec: `Expected ... - at `$.plan.block[0].rest_s``."""
    allowed, _, place = message.partition(" - at ")
    key = place.strip("`").removeprefix("$").removeprefix(".")
    field = re.search(r"required field `(\w+)`|unknown field `(\w+)`", allowed)
    if field is None:
        return ProfileError(file, key, _value_at(table, key), allowed)
    name = field[1] or field[2]
    full = f"{key}.{name}" if key else name
    if field[1]:
        return ProfileError(file, full, None, "this key is missing")
    return ProfileError(file, full, _value_at(table, full), "this key is unknown")


def _value_at(table: dict[str, Any], key: str) -> object:
    value: Any = table
    for name, index in re.findall(r"(\w+)|\[(\d+)\]", key):
        value = value[name] if name else value[int(index)]
    return value


def _contradictions(profile: Profile) -> Iterator[tuple[str, object, str]]:
    """Values that are allowed alone, and not beside another one: key, value, what is allowed."""
    limits, goal, plan = profile.range, profile.goal, profile.plan
    if len(set(profile.legs)) != len(profile.legs):
        yield "legs", profile.legs, "each leg once"
    for name, low, high in (
        ("range.cadence_max_hz", limits.cadence_min_hz, limits.cadence_max_hz),
        ("range.amplitude_max_ratio", limits.amplitude_min_ratio, limits.amplitude_max_ratio),
        ("goal.share_max_ratio", goal.share_min_ratio, goal.share_max_ratio),
    ):
        if high < low:
            yield name, high, f"at least {name.replace('max', 'min')}, which is {low:g}"
    if not goal.share_min_ratio <= goal.share_start_ratio <= goal.share_max_ratio:
        allowed = (
            f"from {goal.share_min_ratio:g} to {goal.share_max_ratio:g}, the therapist's bounds"
        )
        yield "goal.share_start_ratio", goal.share_start_ratio, allowed
    walks = {"plan.warm_up": plan.warm_up}
    walks |= {f"plan.block[{index}]": walk for index, walk in enumerate(plan.block)}
    for key, walk in walks.items():
        for name, value, low, high in (
            ("cadence_hz", walk.cadence_hz, limits.cadence_min_hz, limits.cadence_max_hz),
            (
                "amplitude_ratio",
                walk.amplitude_ratio,
                limits.amplitude_min_ratio,
                limits.amplitude_max_ratio,
            ),
        ):
            if not low <= value <= high:
                yield f"{key}.{name}", value, f"from {low:g} to {high:g}, the profile's range"


def _rendered(value: object) -> str:
    if value is None:
        return "(missing)"
    text = f'"{value}"' if isinstance(value, str) else str(value)
    short = text[: RENDERED_LENGTH_MAX - 1] + "…"
    return text if len(text) <= RENDERED_LENGTH_MAX else short
