"""The form of a training profile on the therapist's page: what it is filled with, and its saving.

The patient's server reads the profile again before each session, and never within one.
"""

from collections.abc import Mapping
from typing import Any, Final

import msgspec
from gaitd_session.profile import BLOCKS_MAX, Wrong
from gaitd_toml import ConfigError
from starlette.responses import Response

from gaitd_display.profile_file import (
    Bounds,
    ConflictError,
    NotWrittenError,
    WrongValuesError,
    bounds,
    change_profile,
    read_text,
    values_of,
)
from gaitd_display.settings import SessionFiles
from gaitd_display.web import Answer, json
from gaitd_display.words import spoken

PROFILE_MAX_BYTES: Final = 16_384
"""Longest request: 50 parts, with all digits of their numbers."""


class ProfileForm(msgspec.Struct, frozen=True):
    """What the form is filled with."""

    sha256: str
    """SHA-256 of the file; it is sent back with the changed values."""
    values: dict[str, Any]
    bounds: dict[str, Bounds]
    """What each number may be, by key, without the index of a part."""
    blocks_max: int


class WrongValue(msgspec.Struct, frozen=True):
    """A value that is not allowed; null: no number."""

    key: str
    value: float | None
    value_low: float | None
    value_high: float | None


class WrongValues(msgspec.Struct, frozen=True):
    """Answer to values that are not allowed."""

    wrong: tuple[WrongValue, ...]
    """In the order of the form."""
    reason: str
    """For a program that is not the page."""
    outcome: str = "refused"


def profile_form(files: SessionFiles | None) -> Response:
    """Return what the form is filled with; call it in a thread."""
    if files is None:
        return json(_refused("no_profile"), 404)
    try:
        read = read_text(files.profile)
    except ConfigError as error:
        return json(_refused("trouble.profile", error), 409)
    return json(ProfileForm(read.sha256, values_of(read.profile), bounds(), BLOCKS_MAX))


def save_profile(files: SessionFiles | None, sha256: str, values: Mapping[str, Any]) -> Response:
    """Write the values, and a line of the journal with the old and the new ones; in a thread."""
    if files is None:
        return json(_refused("no_profile"), 404)
    try:
        changes = change_profile(files.profile, sha256, values)
    except WrongValuesError as error:
        wrong = tuple(_wrong(one) for one in error.wrong)
        return json(WrongValues(wrong, str(error)), 400)
    except ConflictError:
        return json(_refused("profile_conflict"), 409)
    except ConfigError as error:
        return json(_refused("trouble.profile", error), 409)
    except NotWrittenError as error:
        return json(_refused("trouble.profile_not_written", error), 500)
    if changes:
        told = ", ".join(f"{one.key} {_text(one.before)} -> {_text(one.after)}" for one in changes)
        print(f"gaitd-display: {files.profile} changed: {told}", flush=True)
    return json(Answer("done"))


def _wrong(one: Wrong) -> WrongValue:
    value = one.value if isinstance(one.value, int | float) else None
    return WrongValue(one.key, value, one.value_low, one.value_high)


def _text(value: object) -> str:
    return "(none)" if value is None else f"{value:g}" if isinstance(value, float) else f"{value}"


def _refused(key: str, said: object = "") -> Answer:
    group = key if "." in key else f"label.{key}"
    return Answer("refused", key, spoken(lambda texts: texts.text(group, said=str(said))))
