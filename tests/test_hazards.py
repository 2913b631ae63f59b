"""The hazard table points at what exists: every file, every test by name, every cause of a stop."""

import ast
import re
from functools import cache
from pathlib import Path

from gaitd_names import Cause

PROJECT = Path(__file__).resolve().parent.parent
PAGE = PROJECT / "docs" / "hazards.md"
NAMED_TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")
NAMED_FILE = re.compile(r"`([\w/]+/[\w/.]+\.(?:py|md|toml))`")
CLOCKS = {"time", "time_ns", "now", "utcnow", "today", "gmtime", "localtime"}
"""Functions of `time` and `datetime` that tell the time of day."""


def rows():
    """The cells of each numbered row, by its number."""
    found = {}
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if cells and cells[0].isdigit():
            found[int(cells[0])] = cells
    return found


ROWS = rows()


@cache
def functions(file):
    """Names of all functions of a file, methods too."""
    tree = ast.parse((PROJECT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_the_rows_are_numbered_from_one_without_a_gap_and_each_has_its_five_cells():
    assert list(ROWS) == list(range(1, len(ROWS) + 1))
    assert len(ROWS) >= 25
    for number, cells in ROWS.items():
        assert len(cells) == 5, number
        assert all(cells), number


def test_every_row_names_a_control_that_exists_and_tests_that_exist():
    for number, (_, _, _, control, verification) in ROWS.items():
        files = NAMED_FILE.findall(control)
        tests = NAMED_TEST.findall(verification)

        assert files, number
        assert all((PROJECT / file).is_file() for file in files), (number, files)
        assert tests, number
        assert len(tests) == verification.count("::"), f"{number}: a test is named in another way"
        unknown = [
            f"{number}: {file}::{name}"
            for file, name in tests
            if not (PROJECT / file).is_file()
            or not name.startswith("test_")
            or name not in functions(file)
        ]
        assert not unknown


def test_every_file_that_the_page_names_exists():
    for file in NAMED_FILE.findall(PAGE.read_text(encoding="utf-8")):
        assert (PROJECT / file).is_file(), file


def test_every_cause_of_a_stop_comes_about_in_some_row():
    told = {word for cells in ROWS.values() for word in re.findall(r"`([A-Z_]+)`", cells[2])}

    assert told == {cause.name for cause in Cause if cause is not Cause.NONE}


def test_what_a_row_says_is_wired_is_a_condition_of_the_page():
    text = PAGE.read_text(encoding="utf-8")
    conditions = set(re.findall(r"^\| (W\d+) \|", text, re.MULTILINE))

    assert conditions
    assert set(re.findall(r"\bW\d+\b", text)) == conditions


def test_no_decision_reads_the_time_of_day():
    """Only `daemon/system/clock.py` may, for records; the linter holds `time`, this `datetime`."""
    for package in ("daemon", "drives", "observer"):
        for file in sorted((PROJECT / package).rglob("*.py")):
            if file.name == "clock.py":
                continue
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Attribute) and node.attr in CLOCKS:
                    owner = node.value
                    name = owner.attr if isinstance(owner, ast.Attribute) else ast.unparse(owner)
                    assert name not in {"time", "datetime", "date"}, f"{file}:{node.lineno}"
