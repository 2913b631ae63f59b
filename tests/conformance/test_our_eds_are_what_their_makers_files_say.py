"""The EDS of our virtual drives against facts that were read from the makers' public files.

`makers/*.csv` has these facts; each names its source. The head of an EDS lists the objects whose
values, or existence, are the virtual drive's own; every other difference is a mistake of ours.
"""

import csv
import re
from pathlib import Path
from typing import NamedTuple

import canopen
import pytest
from canopen.objectdictionary import ODVariable

EDS = Path(__file__).parents[2] / "configs/drives"
FACTS = Path(__file__).parent / "makers"
MAKES = {"epos4.eds": "epos4_50_5.csv", "elmo_gold.eds": "elmo_gold.csv"}
NODE_ID = 5
TYPES = {2: "i8", 3: "i16", 4: "i32", 5: "u8", 6: "u16", 7: "u32", 9: "string"}


class Facts(NamedTuple):
    """One object: its type, access and right to be mapped, and its limits and default."""

    type: str
    access: str
    mapped: str
    low: int | None
    high: int | None
    default: int | str | None


def number(text):
    """The number of a field: decimal, hexadecimal with h, or node+ in front of the latter."""
    base, _, offset = text.rpartition("+")
    if offset.endswith("h"):
        return int(offset[:-1], 16) + (NODE_ID if base else 0)
    return int(text) if text else None


def told(make):
    """What the maker's file says, by address; None for an object that it does not have."""
    with (FACTS / MAKES[make]).open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    facts = {}
    for row in rows:
        index, subs = row["object"].split(":")
        first, _, last = subs.partition("-")
        limits = [number(row[name]) for name in ("low", "high", "default")]
        fact = Facts(row["type"], row["access"], row["mapped"], *limits)
        for sub in range(int(first, 16), int(last or first, 16) + 1):
            facts[int(index, 16), sub] = None if fact.type == "absent" else fact
    return facts


def described(make):
    """What our EDS says, by address."""
    dictionary = canopen.import_od(str(EDS / make), NODE_ID)
    facts = {}
    for index in dictionary:
        found = dictionary.indices[index]
        for variable in [found] if isinstance(found, ODVariable) else found.values():
            facts[variable.index, variable.subindex] = Facts(
                TYPES[variable.data_type],
                variable.access_type,
                "yes" if variable.pdo_mappable else "no",
                variable.min,
                variable.max,
                variable.default,
            )
    return facts


def listed(make):
    """The objects that the head of our EDS lists as its own."""
    head, _, _ = (EDS / make).read_text().partition("[FileInfo]")
    found = re.findall(r"^;   ([0-9A-F]{4})h(?::([0-9A-F]{2}))?  +\S", head, re.MULTILINE)
    return {(int(index, 16), int(sub or "0", 16)) for index, sub in found}


@pytest.fixture(params=MAKES)
def make(request):
    return request.param


def test_our_eds_has_no_object_that_its_maker_does_not_have(make):
    makers = told(make)

    beyond = {address for address in described(make) if makers.get(address) is None}

    assert beyond <= listed(make)


def test_our_eds_has_each_object_of_the_table(make):
    missing = {a for a, facts in told(make).items() if facts is not None} - set(described(make))

    assert missing == set()


def test_each_object_is_as_its_maker_describes_it_or_listed_in_the_head(make):
    makers = told(make)
    different = {
        a: (facts, makers[a]) for a, facts in described(make).items() if makers[a] != facts
    }

    assert set(different) == listed(make)
    for ours, maker in different.values():
        assert maker is None or ours[:3] == maker[:3]  # a value or a limit, never type or access
