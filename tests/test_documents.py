"""What the documents link to exists, and each command in them is one that the programs accept.

Commands that are cheap and harmless are also run, by `tests/service/test_documented_commands.py`.
"""

import contextlib
import functools
import importlib
import json
import re
import runpy
from pathlib import Path
from urllib.parse import unquote

import gaitd_assist.program
import gaitd_display.__main__
import gaitd_session.program
import pytest
import typer
from documents import PAGES, PROJECT, commands, spans, unmarked, without_code
from gaitd_session.store import EXPORTED
from typer._click.exceptions import BadOptionUsage

from analysis import estimates, recording, stop_tables, stride_table
from gaitd.__main__ import build, commands_for
from sim_drives.plant.truth import TruthRow

LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+)\)")
TARGETS = set(re.findall(r"^([a-z-]+):", (PROJECT / "Makefile").read_text(), re.MULTILINE))
EVERY_COMMAND = commands_for(None)
UNITS = {path.name.partition(".")[0] for path in (PROJECT / "systemd").rglob("gaitd*")}


def anchors(page: Path) -> set[str]:
    """GitHub's names of the headings of a page."""
    names: dict[str, int] = {}
    for heading in re.findall(r"^#+ (.+)$", without_code(page.read_text()), re.MULTILINE):
        name = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        names[name] = names.get(name, -1) + 1
        if names[name]:
            names[f"{name}-{names[name]}"] = 0
    return set(names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PROJECT)))
def test_links_of_a_page_lead_to_files_and_headings(page):
    for link in LINK.findall(without_code(page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = unquote(link).partition("#")
        target = (page.parent / name).resolve() if name else page

        assert target.is_file(), f"{page.name} links to {link}"
        assert target.is_relative_to(PROJECT)
        if anchor:
            assert anchor in anchors(target), f"{page.name} links to {link}"


def test_the_indices_lead_to_every_page():
    indices = [PROJECT / "docs/index.md", PROJECT / "docs/evidence/README.md"]
    linked = {
        (index.parent / one).resolve()
        for index in indices
        for one in re.findall(r"\]\(([^)#]+)\)", index.read_text(encoding="utf-8"))
    }

    assert set(PAGES) - linked == {indices[0]}


def test_the_index_of_the_evidence_gives_the_medians_of_strides():
    index = (PROJECT / "docs/evidence/README.md").read_text(encoding="utf-8")
    strides = (PROJECT / "docs/evidence/strides.md").read_text(encoding="utf-8")
    rows = re.findall(r"\| 0.25 Hz \| (?:passive: filter|active: \w+), rms error \|(.*)", strides)
    medians = [re.findall(r" ([\d.]+)(?: \(.*?\))? (N·m|N) ", row) for row in rows]

    assert [len(one) for one in medians] == 9 * [2]  # filter, smoother, passive; three tables
    for (hip, hip_unit), (slide, slide_unit) in medians:
        assert f"| {hip} {hip_unit}, {slide} {slide_unit} |" in index


def test_every_block_of_commands_is_marked_as_one():
    """```sh, so that the tests below find it; a transcript is ```console, its prompt `$ `."""
    assert [place for page in PAGES for place in unmarked(page)] == []


# --- commands ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with what the project has, in which every other file of an example can be made."""
    folder = tmp_path_factory.mktemp("reader")
    for one in PROJECT.iterdir():
        if not one.name.startswith("."):
            (folder / one.name).symlink_to(one)
    return folder


def make_files(folder, words):
    """The files that an example calls its own: their names have no folder, or are in capitals."""
    for word in words:
        if re.fullmatch(r"[\w*]+(\.\w+)+|[A-Z_]+(\.\w+)?", word):
            if word in ("FOLDER", "RECORDINGS"):
                (folder / word).mkdir(exist_ok=True)
            else:
                (folder / word).touch()


def accept_typer(command, words, folder):
    """Refuse as the program would: unknown words, wrong choices, files that do not exist.

    Without a folder, of a sentence: unknown words and options alone.
    """
    context = command.make_context(words[0], list(words[1:]), resilient_parsing=True)
    for name in words[1:]:
        if not hasattr(command, "commands") or name.startswith("-"):
            break
        assert name in command.commands, f"no command {name}"
        command, words = command.commands[name], words[1:]
        context = type(context)(command, info_name=name, parent=context)
    if folder is None:
        with contextlib.suppress(BadOptionUsage):  # a sentence leaves its value out
            command.make_parser(context).parse_args(list(words[1:]))
        return
    with contextlib.chdir(folder):
        command.make_context(words[0], list(words[1:]), parent=context.parent)


CLIENTS = {
    "gaitd-assist": typer.main.get_command(gaitd_assist.program.app),
    "gaitd-display": typer.main.get_command(gaitd_display.__main__.app),
    "gaitd-session": typer.main.get_command(gaitd_session.program.app),
}


@functools.cache
def gaitd(chosen):
    """The command line in which one command is not a stub."""
    return typer.main.get_command(build(chosen))


def accept(words, folder):
    """One branch for each program."""
    program, *rest = words
    if program == "gaitd":
        pair = " ".join(rest[:2])
        if pair in EVERY_COMMAND:
            rest, words = [pair, *rest[2:]], (program, pair, *rest[2:])
        name = next((word for word in rest if word not in ("--help", "-h", "--version")), "run")
        assert name in EVERY_COMMAND, f"no command {name}"
        accept_typer(gaitd(name), words, folder)
    elif program in CLIENTS:
        accept_typer(CLIENTS[program], words, folder)
    elif program == "make":
        assert set(filter(lambda word: "=" not in word, rest)) <= TARGETS
    else:
        accept_other(program, rest)


def accept_other(program, rest):
    """Programs that are not ours: what they are given of ours exists."""
    if program in ("systemctl", "journalctl"):
        named = [word for word in rest if word.startswith("gaitd")]
        assert {word.partition(".")[0] for word in named} <= UNITS
        return
    if program == "sed":
        rest = rest[2:]  # -i and what is replaced
    paths = [word.partition("[")[0] for word in rest if re.match(r"\.?/?[\w-]+/", word)]
    for path in paths:
        assert path.startswith("/") or (PROJECT / path).exists(), f"{path} does not exist"


def test_the_pages_have_more_than_eighty_commands():
    assert len([command for page in PAGES for command in commands(page)]) > 80


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PROJECT)))
def test_commands_of_a_page_are_accepted_and_those_within_sentences_are_there(page, folder):
    for command in commands(page):
        print(command.place, command.text)  # the last one is wrong
        make_files(folder, command.words)
        accept(command.words, folder)
    for command in spans(page):
        print(command.place, command.text)
        accept(command.words, None)


def test_every_key_of_the_configuration_has_a_meaning():
    page = (PROJECT / "docs/configuration.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`\w+`) \|.*?\|[^|]*\| *(.*?) *\|$", page, re.MULTILINE)

    assert len(rows) > 480
    assert [key for key, meaning in rows if not meaning] == []


def test_every_constant_of_the_python_packages_has_a_value_a_unit_and_a_meaning(monkeypatch):
    monkeypatch.syspath_prepend(PROJECT / "scripts")
    reference = importlib.import_module("python_reference")
    rows = [row for package in reference.PACKAGES for row in reference.constants(package)]
    found = {row.name: row for row in rows}

    assert [row for row in rows if not all(row)] == []
    assert found["`stream.SILENCE_NS`"][1:3] == ("`200000000`", "ns")
    assert found["`lease.NS_PER_S`"].unit == "ns/s"
    assert {"`wire.JOINTS`", "`POWER_STATES`", "`LANGUAGES`"} <= found.keys()


@pytest.mark.parametrize(
    ("page", "heading"),
    [("first_start.md", "## What may go wrong"), ("troubleshooting.md", "| symptom |")],
)
def test_a_message_that_a_page_explains_is_one_that_a_program_prints(page, heading):
    _, _, table = (PROJECT / "docs" / page).read_text(encoding="utf-8").partition(heading)
    printed = "".join(
        path.read_text(encoding="utf-8")
        for folder in ("clients/python/gaitd_texts", "gaitd", "drives/bringup", "simtime")
        for path in (PROJECT / folder).iterdir()
        if path.suffix in (".py", ".toml")
    )
    quoted = re.findall(r'"([^"]+)"', "\n".join(re.findall(r"^\|(.*?) \|", table, re.MULTILINE)))

    assert len(quoted) > 7
    assert [one for one in quoted for part in one.split("…") if part not in printed] == []


# --- pages that a command writes -------------------------------------------------------------


def columns_of(section: str) -> set[str]:
    """Names in the first cells of a section's table."""
    cells = re.findall(r"^\| (`.*?) \|", section, re.MULTILINE)
    return {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}


def test_the_page_of_csv_columns_has_those_that_the_programs_write_and_no_other():
    page = (PROJECT / "docs/csv_columns.md").read_text(encoding="utf-8")
    _, *sections = re.split(r"^##+ ", page, flags=re.MULTILINE)
    written = {section.partition("\n")[0]: columns_of(section) for section in sections}

    assert written == {
        "Recording: input of `gaitd replay`, `calibrate`, `delay` and `baseline`": set(
            recording.COLUMNS
        ),
        "Estimates: `gaitd replay --output`": set(estimates.COLUMNS),
        "Strides: `gaitd replay --strides`": set(stride_table.columns()),
        "A stop: `gaitd blackbox show --csv`": {*recording.COLUMNS, *stop_tables.MORE_COLUMNS},
        "Truth of the virtual machine: `gaitd sim --truth`": set(TruthRow._fields),
        "History of training: `gaitd-session export`": set(EXPORTED),
    }


@pytest.fixture(scope="module")
def pages():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(PROJECT / "scripts")
        return runpy.run_path(str(PROJECT / "scripts/pages.py"))


@pytest.mark.parametrize(
    ("text", "same"),
    [
        (
            '"""Another text."""\n\nLIMIT = 3  # why\n\n\n'
            'def f():\n    """Now."""\n    return ""\n',
            True,
        ),
        ("LIMIT = 4\n\n\ndef f():\n    return ''\n", False),
        ("LIMIT = 3\n\n\ndef f():\n    return None\n", False),
    ],
)
def test_sources_are_the_same_while_only_comments_and_docstrings_change(
    pages, tmp_path, text, same
):
    before, after = tmp_path / "before.py", tmp_path / "after.py"
    before.write_text("LIMIT = 3\n\n\ndef f():\n    return ''\n")
    after.write_text(text)

    assert (pages["code_digest"](before) == pages["code_digest"](after)) is same


def test_what_a_page_is_made_from_is_all_that_its_command_imports(pages):
    found = pages["sources"](pages["LONG"]["evidence/consistency.md"])

    assert PROJECT / "observer/filter/cdkf.py" in found
    assert PROJECT / "configs/robot_empty.toml" in found
    assert not [file for file in found if file.is_relative_to(PROJECT / "daemon/gateway")]


def test_every_picture_is_made_by_a_command_that_is_known(pages):
    made = {Path(page).stem for page in pages["LONG"]}
    others = [
        picture.name
        for picture in (PROJECT / "docs").rglob("*.png")
        if not made & {picture.stem, picture.stem.rpartition("_")[0], picture.parent.name}
    ]

    assert others == []


def test_every_long_page_has_digests_and_gated_files_alone_have_rows_of_mutants(pages):
    stored = json.loads((PROJECT / "docs/sources.json").read_text())
    mutants = (PROJECT / "docs/evidence/mutants.md").read_text(encoding="utf-8")

    assert stored.keys() == pages["LONG"].keys()
    assert {file for file, _ in pages["MUTATED"].findall(mutants)} <= pages["UNIT_TESTS"].keys()


def test_a_gated_file_that_was_never_mutated_or_has_changed_since_is_named(pages, monkeypatch):
    mutants = (PROJECT / "docs/evidence/mutants.md").read_text(encoding="utf-8")
    (file, digest), *_ = pages["MUTATED"].findall(mutants)
    older, names = pages["older_mutants"], pages["older_mutants"].__globals__
    monkeypatch.setitem(names, "code_digest", lambda _: digest)
    monkeypatch.setitem(names, "UNIT_TESTS", {file: ()})
    assert list(older()) == []

    monkeypatch.setitem(names, "UNIT_TESTS", {file: (), "daemon/new.py": ()})
    assert [line.endswith(" scripts/mutants.py daemon/new.py") for line in older()] == [True]
    monkeypatch.setitem(names, "code_digest", lambda _: "other")
    assert [line.endswith(f" {file} daemon/new.py") for line in older()] == [True]
