"""What each fact of a drive profile rests on: `[[sources]]` and `must_show`.

A fact is a key of the profile as its file has it: `velocity_unit`, `torque_source.sampling`, and
for an entry of `written` or `checked` its object, `written.605Ah:00`. A name in `states` or in
`must_show` is a fact or the begin of some: `torque_source` means all of that table. Of two names
that fit a fact the longer one counts. Each fact has a source, or is one that the drive must show.
"""

from collections.abc import Container, Iterator
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from drives.cia402.torque import ObjectRef, Table
from drives.errors import DescriptionError

_NO_FACTS: Final = frozenset(("vendor", "family", "verified_on_hardware", "sources", "must_show"))


class Source(Table, frozen=True, kw_only=True):
    """A public document or file, and the facts that it states."""

    what: Annotated[str, Meta(min_length=20)]
    """Document or file, with its version."""
    states: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Keys of this profile that it states."""


def facts(profile: msgspec.Struct) -> tuple[str, ...]:
    """All facts of a profile, by key."""
    return tuple(key for key, value in _keys(profile, "") if not _is_absent(value))


def open_facts(
    profile: msgspec.Struct, sources: tuple[Source, ...], must_show: tuple[str, ...]
) -> tuple[str, ...]:
    """The facts that no public document states, in the order of the profile."""
    stated = {name for source in sources for name in source.states}
    return tuple(fact for fact in facts(profile) if _best(fact, must_show) > _best(fact, stated))


def check_sources(
    profile: msgspec.Struct, sources: tuple[Source, ...], must_show: tuple[str, ...]
) -> None:
    """Check that each fact has a source or must be shown, and that each name is one of a key.

    Raises:
        DescriptionError: names the fact, or the name.
    """
    keys = dict(_keys(profile, ""))
    above = {part for key in keys for part in _parts(key)}
    absent = {key for key, value in keys.items() if _is_absent(value)}
    stated = [name for source in sources for name in source.states]
    for where, names in (("sources", stated), ("must_show", must_show)):
        for name in names:
            if name not in above and absent.isdisjoint(_parts(name)):
                raise DescriptionError("profile", where, name, "a key of this profile")
    for fact in facts(profile):
        if not _best(fact, {*stated, *must_show}):
            allowed = "in `states` of a source, or in `must_show` if no public document states it"
            raise DescriptionError("profile", "sources", fact, allowed)


def _keys(table: msgspec.Struct, prefix: str) -> Iterator[tuple[str, object]]:
    for name, field in zip(table.__struct_encode_fields__, table.__struct_fields__, strict=True):
        key, value = prefix + name, getattr(table, field)
        if key in _NO_FACTS:
            continue
        if isinstance(value, msgspec.Struct):
            yield from _keys(value, f"{key}.")
        elif isinstance(value, tuple) and value and isinstance(value[0], ObjectRef):
            yield from ((f"{key}.{one.place}", one) for one in value)
        else:
            yield key, value


def _is_absent(value: object) -> bool:
    return value is None or value == ()


def _parts(key: str) -> Iterator[str]:
    """A key, and the tables that it is in, from the inmost one outwards."""
    while key:
        yield key
        key = key.rpartition(".")[0]


def _best(fact: str, names: Container[str]) -> int:
    """Length of the longest of the names that is the fact or a table that it is in; 0: none."""
    return next((len(part) for part in _parts(fact) if part in names), 0)
