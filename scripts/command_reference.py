"""The reference of the command line, as Markdown, from the parsers of the programs.

`docs/conf.py` puts it below the text of docs/command_line.md when the site is built.
"""

import re
from collections.abc import Iterator
from importlib.metadata import metadata

import typer
from man_pages import programs
from typer.core import TyperCommand

from analysis import markdown
from gaitd.__main__ import COMMANDS

LABORATORY = "gaitd, with the laboratory"


def reference() -> str:
    """Return the sections of all programs, those of the laboratory last."""
    shipped: list[str] = []
    laboratory: list[str] = []
    for program, group, commands in programs():
        shipped.append(f"## {program}\n\n{plain(metadata(program)['Summary'])}")
        for name, command in commands.items():
            line = group.commands[name].get_short_help_str(200)
            of_laboratory = program == "gaitd" and name not in COMMANDS
            section = "\n\n".join(parts(f"{program} {name}", line, command))
            (laboratory if of_laboratory else shipped).append(section)
    return "\n\n".join([*shipped, f"## {LABORATORY}", *laboratory])


def parts(words: str, line: str, command: TyperCommand) -> Iterator[str]:
    """Yield heading, usage, text, arguments and options of one command."""
    context = typer.Context(command, info_name=words)
    usage = re.sub(r"\s+", " ", command.get_usage(context).removeprefix("Usage: "))
    yield f"### {words}\n\n{plain(line)}"
    yield f"```text\n{usage}\n```"
    text = re.sub(r"\s+", " ", command.help or "").strip()
    if text.rstrip(".") != line.rstrip("."):
        yield from (plain(one) for one in (command.help or "").split("\n\n"))
    records = [one.get_help_record(context) for one in command.get_params(context)]
    rows = [
        (f"`{' '.join(term.split())}`", plain(meaning))
        for term, meaning in filter(None, records)
        if term != "--help"
    ]
    if rows:
        yield markdown.table(("argument, option", "meaning"), rows)


def plain(text: str) -> str:
    """Return text on one line, in which Markdown finds no marks but those of code.

    Options are code: two hyphens in text are drawn as a dash.
    """
    line = re.sub(r"\s+", " ", text).strip()
    line = re.sub(r"(?<![\w`-])--[a-z][a-z-]*", r"`\g<0>`", line)
    spans = re.split(r"(`[^`]*`)", line)
    spans[::2] = [re.sub(r"([\\*_<>\[\]$#])", r"\\\1", one) for one in spans[::2]]
    return "".join(spans)
