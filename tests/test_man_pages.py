"""Manual pages are made from the commands."""

import runpy
import sys
from pathlib import Path

import pytest

from gaitd.__main__ import commands_for

COMMANDS = commands_for(None)
MADE = runpy.run_path(str(Path(__file__).parent.parent / "scripts" / "man_pages.py"))


@pytest.fixture(scope="module")
def pages():
    return dict(MADE["pages"]())


def test_each_command_has_a_page_and_a_line_on_the_first(pages):
    names = {"gaitd-" + name.replace(" ", "-") for name in COMMANDS}
    assert {"gaitd", *names, "gaitd-session-run"} <= set(pages)
    for name, (_, _, line) in COMMANDS.items():
        assert f".B {name}\n{line}".replace("-", "\\-") in pages["gaitd"]


def test_a_page_has_the_arguments_and_options_of_its_command(pages):
    page = pages["gaitd-drive"]

    assert ".B gaitd drive\n[OPTIONS] {NAME} {action}\n" in page
    assert ".B action <dump|compare|store|restore>\nwhat to do with it [required]\n" in page
    assert ".B \\-\\-output <path>\ndump: to a DCF, which compare can read\n" in page


def test_the_programs_of_the_clients_have_pages_too(pages):
    for program, commands in (
        ("assist", ["run"]),
        ("display", ["patient", "therapist", "password"]),
    ):
        every = pages[f"gaitd-{program}"]
        assert {f"gaitd-{program}-{name}" for name in commands} <= set(pages)
        assert all(f".B {name}\n" in every for name in commands)
        assert ".SH NAME\ngaitd\\-" in every
    page = pages["gaitd-display-patient"]
    assert "gaitd\\-display\\-patient \\- Serve the patient's page\n" in page
    assert ".B \\-\\-config <file>\n" in page


def test_no_line_of_text_is_a_request_of_roff(pages):
    known = {".TH", ".SH", ".B", ".TP", ".PP", ".nf", ".fi"}
    for page in pages.values():
        assert {line.split()[0] for line in page.splitlines() if line[:1] in (".", "'")} <= known


def test_a_command_without_its_packages_has_no_page_and_the_others_have(monkeypatch):
    for name in ("gaitd_record", "gaitd.record"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "gaitd_record", None)

    assert {name for name, _ in MADE["of_gaitd"]()} == {*COMMANDS} - {"record"}
