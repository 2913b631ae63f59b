"""A profile's file is changed by a program: comments stay, and it is replaced whole or not at all.

A form sends all values that a therapist decides. Version, id and legs are not among them: an id
belongs to a history, and the legs are those of the trainer.
"""

import contextlib
import hashlib
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

import msgspec
import tomlkit
from gaitd_session.profile import Profile, Wrong, contradictions, parse_profile
from gaitd_toml import ConfigError
from gaitd_toml.reader import parse_toml, read_bytes
from msgspec import inspect
from tomlkit.items import AoT, Table

FORM: Final = ("range", "assist", "goal", "plan")
"""Tables of the file that a form changes."""


class Bounds(msgspec.Struct, frozen=True):
    """What a number may be."""

    value_low: float
    value_high: float


class ProfileText(NamedTuple):
    """A profile as its file had it."""

    profile: Profile
    text: str
    sha256: str


class Change(NamedTuple):
    """A value that is another one now; None: there was none, or there is none any more."""

    key: str
    before: object
    after: object


class WrongValuesError(Exception):
    """Values of the form are not allowed."""

    def __init__(self, wrong: Sequence[Wrong]) -> None:
        """Keep all of them."""
        super().__init__("; ".join(f"{one.key} = {one.value}: {one.allowed}" for one in wrong))
        self.wrong = wrong


class ConflictError(Exception):
    """The file is not the one that the form was filled from."""


class NotWrittenError(Exception):
    """The file is as before: which one, why, and what to do."""


def read_text(file: Path) -> ProfileText:
    """Read a profile with its text.

    Raises:
        ConfigError: as `read_profile`.
    """
    data = read_bytes(file, "TOML file")
    parse_toml(file, data)  # says where it is not UTF-8
    text = data.decode()
    return ProfileText(parse_profile(text, file), text, hashlib.sha256(data).hexdigest())


def values_of(profile: Profile) -> dict[str, Any]:
    """Return the values of a form."""
    return {name: msgspec.to_builtins(getattr(profile, name)) for name in FORM}


def bounds() -> dict[str, Bounds]:
    """Return the bounds of each number; an index of a block is left out of its key."""
    return dict(_bounds(inspect.type_info(Profile), ""))


def change_profile(file: Path, sha256: str, values: Mapping[str, Any]) -> list[Change]:
    """Put the values of a form into the file.

    Args:
        file: of a profile.
        sha256: of the file that the form was filled from.
        values: as `values_of`; no value may be left out.

    Returns: what is another value now; empty: nothing, and the file was not touched.

    Raises:
        ConfigError: the present file is no profile.
        ConflictError: it is another one than that of `sha256`.
        WrongValuesError: the values are not allowed.
        NotWrittenError: nothing was written.
    """
    before = read_text(file)
    if before.sha256 != sha256:
        raise ConflictError(f"{file} was changed meanwhile")
    wanted = _wanted(before.profile, values)
    old, new = (dict(_leaves(values_of(one), "")) for one in (before.profile, wanted))
    changes = [
        Change(key, old.get(key), new.get(key))
        for key in dict.fromkeys((*old, *new))
        if old.get(key) != new.get(key)
    ]
    if changes:
        text = _edited(before.text, wanted)
        try:
            made = parse_profile(text, file)
        except ConfigError as error:  # a number that no file may hold, 1e-12 for example
            found = (error, *error.more)
            raise WrongValuesError(
                [Wrong(one.key, one.value, None, None, one.allowed) for one in found]
            ) from error
        if made != wanted:
            raise NotWrittenError(f"{file}: its form is not known to this program; edit it by hand")
        _replace(file.resolve(), text)
    return changes


# --- values -------------------------------------------------------------------------------------


def _wanted(before: Profile, values: Mapping[str, Any]) -> Profile:
    known = bounds()
    wrong = [
        Wrong(key, value, low, high, f"{low:g} to {high:g}")
        for key, value in _leaves(values, "")
        if (limits := known.get(_without_index(key))) is not None
        for low, high in ((limits.value_low, limits.value_high),)
        if not isinstance(value, int | float) or isinstance(value, bool) or not low <= value <= high
    ]
    if wrong:
        raise WrongValuesError(wrong)
    kept = {"version": before.version, "id": before.id, "legs": before.legs}
    try:
        profile = msgspec.convert({**values, **kept}, Profile)
    except msgspec.ValidationError as error:
        raise WrongValuesError([Wrong("", None, None, None, str(error))]) from error
    if wrong := contradictions(profile):
        raise WrongValuesError(wrong)
    return profile


def _leaves(value: object, key: str) -> Iterator[tuple[str, object]]:
    """Yield each value with its dotted key; one that is not there is left out."""
    if isinstance(value, Mapping):
        for name, one in cast("Mapping[str, object]", value).items():
            if one is not None or name != "passive":
                yield from _leaves(one, f"{key}.{name}" if key else name)
    elif isinstance(value, (list, tuple)):
        for index, one in enumerate(cast("Sequence[object]", value)):
            yield from _leaves(one, f"{key}[{index}]")
    else:
        yield key, value


def _without_index(key: str) -> str:
    return "".join(part.partition("]")[2] or part for part in key.split("["))


def _bounds(kind: inspect.Type, key: str) -> Iterator[tuple[str, Bounds]]:
    while isinstance(kind, inspect.Metadata):
        kind = kind.type
    match kind:
        case inspect.StructType():
            for field in kind.fields:
                yield from _bounds(
                    field.type, f"{key}.{field.encode_name}" if key else field.encode_name
                )
        case inspect.UnionType():
            for one in kind.types:
                yield from _bounds(one, key)
        case inspect.VarTupleType():
            yield from _bounds(kind.item_type, key)
        case inspect.FloatType(ge=low, le=high) if low is not None and high is not None:
            yield key, Bounds(low, high)
        case _:
            pass


# --- the file -----------------------------------------------------------------------------------


def _edited(text: str, wanted: Profile) -> str:
    """Return the text with other values; what is a number stays in its line, with its comment."""
    document = tomlkit.parse(text)
    values = values_of(wanted)
    for name in ("range", "assist", "goal"):
        _put(cast("Table", document[name]), values[name])
    plan, walks = cast("Table", document["plan"]), values["plan"]
    _put(cast("Table", plan["warm_up"]), walks["warm_up"])
    if walks["passive"] is None:
        plan.pop("passive", None)
    elif "passive" in plan:
        _put(cast("Table", plan["passive"]), walks["passive"])
    else:
        plan["passive"] = _table(walks["passive"])
    blocks = cast("AoT", plan["block"])
    for block, walk in zip(blocks, walks["block"], strict=False):
        _put(cast("Table", block), walk)
    while len(blocks) > len(walks["block"]):
        del blocks[-1]
    for walk in walks["block"][len(blocks) :]:
        blocks.append(_table(walk))
    return tomlkit.dumps(document)


def _put(table: Table, values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        if isinstance(value, Mapping):
            _put(cast("Table", table[name]), cast("Mapping[str, Any]", value))
        elif table[name] != value:
            table[name] = value


def _table(values: Mapping[str, Any]) -> Table:
    table = tomlkit.table()
    table.update(values)
    return table


def _replace(file: Path, text: str) -> None:
    """Replace a file; the users who could read it can read the new one.

    Raises:
        NotWrittenError: this user may not write it, or its readers would lose it.
    """
    temporary: Path | None = None
    try:
        status = file.stat()
        if not os.access(file, os.W_OK):
            raise NotWrittenError(f"{file}: not writable for the user of this program")
        descriptor, name = tempfile.mkstemp(prefix=f".{file.name}.", dir=file.parent)
        temporary = Path(name)
        with os.fdopen(descriptor, "w", encoding="utf-8") as opened:
            _keep_readers(file, descriptor, status)
            opened.write(text)
            opened.flush()
            os.fsync(descriptor)
        temporary.replace(file)
        temporary = None
        _sync(file.parent)
    except OSError as error:
        raise NotWrittenError(f"{file}: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def _keep_readers(file: Path, descriptor: int, status: os.stat_result) -> None:
    made = os.fstat(descriptor)
    if made.st_gid != status.st_gid:
        try:
            os.fchown(descriptor, -1, status.st_gid)
        except PermissionError as error:
            told = f"{file}: its group cannot be kept; give it the group of this program"
            raise NotWrittenError(told) from error
    if made.st_uid != status.st_uid:
        with contextlib.suppress(PermissionError):  # only root may; the readers are the group
            os.fchown(descriptor, status.st_uid, -1)
    os.fchmod(descriptor, stat.S_IMODE(status.st_mode))


def _sync(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
