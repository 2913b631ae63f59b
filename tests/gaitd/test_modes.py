"""docs/modes.md is drawn from the table, and says all of it."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest

from daemon.core.modes.table import TRANSITIONS
from daemon.ipc.record import Cause, Mode
from gaitd_lab.mode_page import REQUESTS, WELL, diagram, page
from gaitd_lab.role_page import with_tables

PROJECT = Path(__file__).parents[2]
LIMITS = tomllib.loads((PROJECT / "configs/limits.toml").read_text())
PAGE = page(LIMITS["stop_category"])


def test_the_page_in_the_docs_is_the_one_of_the_tables():
    """If this fails: `make tables`, and read what has changed."""
    assert (PROJECT / "docs/modes.md").read_text(encoding="utf-8") == PAGE


def test_generated_pages_and_tables_in_the_docs_are_those_of_the_code(tmp_path):
    """If this fails: `make tables`, and read what has changed."""
    text = (PROJECT / "docs/security.md").read_text(encoding="utf-8")
    older = tmp_path / "security.md"
    place = r"(begin -->\n).*?(\n<!-- \w+: end)"
    older.write_text(re.sub(place, r"\1older\2", text, flags=re.DOTALL), encoding="utf-8")

    runpy.run_path(str(PROJECT / "scripts/tables.py"))["write"](tmp_path)

    assert older.read_text(encoding="utf-8") == text
    for page_name in ("modes.md", "messages.md", "configuration.md", "csv_columns.md"):
        written = (tmp_path / page_name).read_text(encoding="utf-8")
        assert written == (PROJECT / "docs" / page_name).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["roles", "rights"])
def test_a_page_without_a_place_for_a_table_is_refused(name):
    text = (PROJECT / "docs/security.md").read_text(encoding="utf-8")

    with pytest.raises(ValueError, match=f"{name}: begin"):
        with_tables(text.replace(f"<!-- {name}: begin -->", ""))


def drawn():
    """The arrows of the diagram as (from, event, to), the common box taken apart."""
    arrows = set()
    for line in diagram():
        found = re.fullmatch(r"\s*(\w+) --> (\w+): (.*)", line)
        if found is None:
            continue
        start, to, events = found.groups()
        starts = [mode.name.lower() for mode in Mode if mode.active]
        for mode in starts if start == "enabled" else [start]:
            arrows |= {(mode, event, to) for event in re.split(r", (?!as |by )", events)}
    return arrows


def test_the_diagram_has_every_row_of_the_table_and_no_other():
    rows = {
        (mode.name.lower(), part, to.name.lower())
        for (mode, event), to in TRANSITIONS.items()
        for part in re.split(r", (?!as |by )", event.value)
    }

    assert drawn() == rows


@pytest.mark.parametrize("cause", [cause for cause in Cause if cause != Cause.NONE])
def test_every_cause_stands_there_with_its_category(cause):
    assert re.search(rf"^\| {cause.name.lower()} \| S[012]", PAGE, re.MULTILINE)


def test_every_request_is_answered_in_every_mode():
    lines = [line for line in PAGE.splitlines() if line.startswith("| ")]

    for name in (*REQUESTS, "stop"):
        row = next(line for line in lines if line.startswith(f"| {name} | ") and "yes" in line)
        assert len(row.split("|")) == 2 + 1 + len(Mode)
    assert WELL.mode == Mode.READY
