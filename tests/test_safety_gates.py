"""Every file in a gated folder has a row in the table of the safety gates."""

import ast
import runpy
from pathlib import Path

import pytest

PROJECT = Path(__file__).parent.parent
GATES = runpy.run_path(str(PROJECT / "scripts/safety_gates.py"))


def has_code(file):
    """More than a docstring."""
    return len(ast.parse(file.read_text(encoding="utf-8")).body) > 1


@pytest.mark.parametrize("folder", GATES["GATED_FOLDERS"])
def test_every_file_of_a_gated_folder_has_its_unit_tests(folder):
    files = {file.relative_to(PROJECT).as_posix() for file in (PROJECT / folder).rglob("*.py")}

    assert {file for file in files if has_code(PROJECT / file)} <= set(GATES["UNIT_TESTS"])


def test_the_table_names_files_that_exist():
    tests = {test for row in GATES["UNIT_TESTS"].values() for test in row}
    named = {*GATES["UNIT_TESTS"], *(f"tests/{test}" for test in tests)}

    assert [file for file in named if not (PROJECT / file).is_file()] == []
