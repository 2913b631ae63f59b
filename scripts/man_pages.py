"""Manual pages of `gaitd`, the programs of clients/ and each of their commands, from their --help.

`scripts/install.sh` calls this with the Python of an environment: man_pages.py FOLDER. What
is not in this environment gets no page.
"""

import importlib
import importlib.util
import re
import sys
from collections.abc import Iterable, Iterator
from importlib.metadata import metadata
from pathlib import Path
from typing import cast

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from gaitd.__main__ import REMEDIES, build, commands_for

DOCUMENTS = "/usr/share/doc/gaitd/docs"
OF_CLIENTS = ("gaitd_assist.program", "gaitd_display.__main__", "gaitd_session.program")
"""Modules of the other programs."""


def pages() -> Iterator[tuple[str, str]]:
    """Yield the name and the text of each page."""
    for program, group, commands in programs():
        lines = {name: one.get_short_help_str(200) for name, one in group.commands.items()}
        yield program, page(program, metadata(program)["Summary"], group, lines)
        for name, command in commands.items():
            yield (
                f"{program}-{name}".replace(" ", "-"),
                page(f"{program} {name}", lines[name], command, {}),
            )


def programs() -> Iterator[tuple[str, TyperGroup, dict[str, TyperCommand]]]:
    """Yield the name of each program, its group, and its commands with their options."""
    # The command line of gaitd is built for one command; the others are stubs in it.
    every = {name: group_of(app).commands[name] for name, app in of_gaitd()}
    yield "gaitd", group_of(build(None)), cast("dict[str, TyperCommand]", every)
    for module in OF_CLIENTS:
        package = module.partition(".")[0]
        if importlib.util.find_spec(package):
            group = group_of(importlib.import_module(module).app)
            commands = cast("dict[str, TyperCommand]", group.commands)
            yield package.replace("_", "-"), group, commands


def of_gaitd() -> Iterator[tuple[str, typer.Typer]]:
    """Yield each command of gaitd whose packages are in this environment."""
    for name in commands_for(None):
        try:
            yield name, build(name)
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] not in REMEDIES:
                raise


def group_of(app: typer.Typer) -> TyperGroup:
    """Return the group of an app's commands."""
    return cast("TyperGroup", get_command(app))


def page(words: str, line: str, command: TyperCommand | TyperGroup, of_it: dict[str, str]) -> str:
    """Return the page of one command; `of_it` are its own commands, each with one line."""
    context = typer.Context(command, info_name=words)
    usage = command.get_usage(context).removeprefix(f"Usage: {words}").strip()
    described = [one.get_help_record(context) for one in command.get_params(context)]
    version = metadata("gaitd")["Version"]
    every = [
        f'.TH {words.replace(" ", "-").upper()} 1 "" "gaitd {version}" "gaitd"',
        f".SH NAME\n{roff(words.replace(' ', '-'))} \\- {roff(line.rstrip('.'))}",
        f".SH SYNOPSIS\n.B {roff(words)}\n{roff(usage)}",
        ".SH DESCRIPTION\n" + "\n.PP\n".join(map(roff, (command.help or line).split("\n\n"))),
        heading("COMMANDS", of_it.items()),
        heading("OPTIONS", [record for record in described if record]),
        f".SH SEE ALSO\n{DOCUMENTS}/index.md, {DOCUMENTS}/exit_codes.md",
    ]
    return "\n".join(filter(None, every)) + "\n"


def heading(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return a section of terms with their explanations; empty without rows."""
    terms = [f".TP\n.B {roff(term)}\n{roff(text)}" for term, text in rows]
    return "\n".join([f".SH {title}", *terms]) if terms else ""


def roff(text: str) -> str:
    """Return text as one paragraph that roff takes literally."""
    line = re.sub(r"\s+", " ", text).strip().replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{line}" if line.startswith((".", "'")) else line


def main(folder: Path) -> None:
    """Write all pages into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages():
        (folder / f"{name}.1").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
