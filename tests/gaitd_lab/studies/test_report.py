"""The one writer of studies: what a quantity over several draws says, and what a page has."""

import math
import re
import statistics

import pytest
from matplotlib.figure import Figure

from gaitd_lab.studies.report import Measured, Report, Table, measured, write


def test_a_quantity_is_median_and_range_of_the_draws_that_have_it():
    draws = [0.31, None, 0.12, math.nan, 0.25, 0.08]
    known = [0.31, 0.12, 0.25, 0.08]

    found = measured(draws, "N·m")

    assert found == (statistics.median(known), min(known), max(known), "N·m")
    assert measured([None, math.nan]) is None


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (Measured(0.25, 0.1, 0.3, "N·m"), "0.25 (0.1 … 0.3) N·m"),
        (Measured(1.0, 1.0, 1.0, "N"), "1 N"),
        (Measured(12345.6, 2.3456, 99999.9), "12346 (2.35 … 100000)"),
        (Measured(0.00005, 0.0, 1.0), "0.0001 (0 … 1)"),
        (Measured(-0.0456, -0.154, 0.0212, "%"), "-0.0456 (-0.154 … 0.0212) %"),
    ],
)
def test_a_quantity_is_written_with_three_digits(found, words):
    assert str(found) == words


def test_a_page_has_date_command_tables_and_the_names_of_its_pictures(tmp_path):
    rows = [("a | b", 1.23456, None), ("c", math.nan, Measured(2.0, 1.0, 3.0, "N"))]
    table = Table("Forces", ("", "hip", "slide"), rows)
    report = Report("study", "A study", (table,), {"one": Figure(), "two": Figure()})

    page, *pictures = write(report, tmp_path / "new", "gaitd study")

    lines = page.read_text("utf-8").splitlines()
    assert lines[0] == "# A study"
    assert re.match(r"`gaitd study` wrote these numbers on \d{4}-\d\d-\d\d\.", lines[5])
    assert "`study_one.png`, `study_two.png`" in lines[7]
    assert lines[-5:-1] == [
        "|  | hip | slide |",
        "| --- | --- | --- |",
        "| a \\| b | 1.23 | – |",
        "| c | – | 2 (1 … 3) N |",
    ]
    assert [one.name for one in pictures] == ["study_one.png", "study_two.png"]
    assert all(one.read_bytes().startswith(b"\x89PNG") for one in pictures)


def test_what_stands_around_the_numbers_of_a_page_is_kept(tmp_path):
    report = Report("study", "A study", (Table("Forces", ("hip",), [(1.0,)]),), {})
    (page,) = write(report, tmp_path, "gaitd study")
    first = page.read_text("utf-8")
    page.write_text(first.replace("# A study\n", "# Read me\n\nWhy.\n") + "\nMore.\n", "utf-8")

    other = Report("study", "A study", (Table("Forces", ("hip",), [(2.0,)]),), {})
    write(other, tmp_path, "gaitd study")

    again = page.read_text("utf-8")
    assert again.startswith("# Read me\n\nWhy.\n")
    assert again.endswith("| 2 |\n<!-- numbers: end -->\n\nMore.\n")
    assert again.count("## Numbers") == 1
