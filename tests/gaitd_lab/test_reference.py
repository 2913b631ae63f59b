"""The reference pages are those of the code, and docs/modes.md says all of the mode table."""

import re
import shutil
from functools import cache
from pathlib import Path

import pytest
from gaitd_names import Cause, Mode

from daemon.core.modes.table import TRANSITIONS
from gaitd_lab.reference import pages
from gaitd_lab.reference.modes import REQUESTS, WELL, diagram, trigger_text

DOCS = Path(__file__).parents[2] / "docs"


@cache
def parts():
    """Made for the tests alone: collection does not wait for it."""
    return pages.parts()


def test_generated_parts_of_the_docs_are_those_of_the_code(tmp_path):
    """If this fails: `make tables`, and read what has changed."""
    for name in parts():
        text = (DOCS / name).read_text(encoding="utf-8")
        place = r"(: begin -->\n).*?(\n<!-- \w+: end)"
        older = re.sub(place, r"\1older\2", text, flags=re.DOTALL)
        copy = tmp_path / "docs" / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_text(older, encoding="utf-8")

    pages.write(tmp_path / "docs")

    for name in parts():
        assert (tmp_path / "docs" / name).read_text("utf-8") == (DOCS / name).read_text("utf-8"), (
            name
        )


@pytest.mark.parametrize("name", ["roles", "rights"])
def test_a_page_without_a_place_for_a_table_is_refused(name, tmp_path):
    for page in parts():
        shutil.copy(DOCS / page, tmp_path)
    page = tmp_path / "security.md"
    page.write_text(page.read_text("utf-8").replace(f"<!-- {name}: begin -->", ""), "utf-8")

    with pytest.raises(ValueError, match=f"{name}: begin"):
        pages.write(tmp_path)


def drawn():
    """The arrows of the diagram as (from, event, to), the common box taken apart."""
    arrows = set()
    for line in diagram():
        found = re.fullmatch(r"\s*(\w+) --> (\w+): (.*)", line)
        if found is None:
            continue
        start, to, events = found.groups()
        starts = [mode for mode in Mode if mode.active]
        for mode in starts if start == "enabled" else [start]:
            arrows |= {(mode, event, to) for event in re.split(r", (?!as |by )", events)}
    return arrows


def test_the_diagram_has_every_row_of_the_table_and_no_other():
    rows = {
        (mode, part, to)
        for (mode, event), to in TRANSITIONS.items()
        for part in re.split(r", (?!as |by )", trigger_text(event))
    }

    assert drawn() == rows


def test_every_cause_stands_there_with_its_category():
    table = parts()["modes.md"]["stops"]

    told = re.findall(r"^\| (\w+) \| S[012]", table, re.MULTILINE)
    assert set(Cause) - set(told) == {Cause.NONE}


def test_every_request_is_answered_in_every_mode():
    lines = parts()["modes.md"]["requests"].splitlines()

    for name in (*REQUESTS, "stop"):
        row = next(line for line in lines if line.startswith(f"| {name} | "))
        assert len(row.split("|")) == 2 + 1 + len(Mode)
    assert WELL.mode == Mode.READY
