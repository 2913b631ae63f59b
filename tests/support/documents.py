"""The documents as a reader meets them: Markdown files, their links, and commands for a shell."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

PROJECT: Final = Path(__file__).parents[2]
PAGES: Final = tuple(
    sorted(
        [
            *PROJECT.glob("*.md"),
            *PROJECT.glob("docs/*.md"),
            *PROJECT.glob("docs/evidence/*.md"),
            *PROJECT.glob("clients/*/README.md"),
        ]
    )
)
PROGRAMS: Final = (
    *("gaitd", "gaitd-assist", "gaitd-display", "gaitd-session", "make", "pip", "pytest"),
    *("python", "python3", "systemctl", "journalctl", "sudo", "ip", "install", "cp"),
)
"""First words of a line that is a command."""
BLOCK: Final = re.compile(r"^(`{3,})(\w*)\n(.*?)^\1$", re.MULTILINE | re.DOTALL)
SPAN: Final = re.compile(r"(?<!`)`(gaitd(?:-\w+)? [^`]+|make [a-z-]+[^`]*)`(?!`)")


class Command(NamedTuple):
    """One command of a page, and where it is."""

    place: str
    """FILE:LINE."""
    words: tuple[str, ...]

    @property
    def text(self) -> str:
        """As one line, without comments and continuation."""
        return " ".join(self.words)


def without_code(text: str) -> str:
    """The text of a page without blocks of code, as many lines as before."""
    return BLOCK.sub(lambda found: "\n" * found[0].count("\n"), text)


def commands(page: Path) -> Iterator[Command]:
    """Every command in the shell blocks of a page, and behind a prompt in the others."""
    text = page.read_text(encoding="utf-8")
    for block in BLOCK.finditer(text):
        first = text.count("\n", 0, block.start(3)) + 1
        lines = block[3].replace("\\\n", "\\").splitlines()
        for number, line in enumerate(lines, first):
            prompted = block[2] == "console" and line.startswith("$ ")
            if block[2] == "sh" or prompted:
                yield from _split(page, number, line.removeprefix("$ ").replace("\\", ""))


def spans(page: Path) -> Iterator[Command]:
    """Every command within a sentence of a page."""
    text = without_code(page.read_text(encoding="utf-8"))
    for span in SPAN.finditer(text):
        line = text.count("\n", 0, span.start()) + 1
        yield from _split(page, line, span[1].replace("\\|", "|"))


def unmarked(page: Path) -> Iterator[str]:
    """Places of commands in blocks without a language: they would not be tested."""
    text = page.read_text(encoding="utf-8")
    for block in BLOCK.finditer(text):
        if block[2] in ("", "bash", "shell"):
            yield from _begun(page, text.count("\n", 0, block.start(3)) + 1, block[3])
    yield from _begun(page, 1, without_code(text), "    ")


def _begun(page: Path, first: int, text: str, indent: str = "") -> Iterator[str]:
    for number, line in enumerate(text.splitlines(), first):
        word = line.removeprefix(indent).partition(" ")[0]
        if line.startswith(indent) and word in PROGRAMS and (indent or " " in line):
            yield f"{page.relative_to(PROJECT)}:{number}: {line.strip()}"


def _split(page: Path, number: int, line: str) -> Iterator[Command]:
    words: list[str] = []
    for word in [*shlex.split(line, comments=True), "&&"]:
        if word != "&&":
            words.append(word)
            continue
        kept = tuple(one for one in words if one != "&")
        words = []
        if kept:
            yield Command(f"{page.relative_to(PROJECT)}:{number}", kept)
