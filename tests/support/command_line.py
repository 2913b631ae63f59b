"""A command line in the test's own process: what an installed script does, without its imports."""

import contextlib
import re
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

from gaitd.__main__ import main as main_of_gaitd


class Ended(NamedTuple):
    """What a command left behind."""

    code: int
    out: str
    err: str


def gaitd(*words: object, folder: Path | str = ".") -> Ended:
    """Run `gaitd WORDS` in a folder."""
    return ran(main_of_gaitd, "gaitd", *words, folder=folder)


def ran(
    main: Callable[[], object], program: str, *words: object, folder: Path | str = "."
) -> Ended:
    """Run `PROGRAM WORDS` in a folder; `main` is the function that its script calls."""
    code = 0
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8") as out,
        tempfile.TemporaryFile("w+", encoding="utf-8") as err,
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        patch.object(sys, "argv", [program, *map(str, words)]),
    ):
        try:
            main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0
        for stream in (out, err):
            stream.seek(0)
        return Ended(code, re.sub(r" +\n", "\n", out.read()), err.read())
