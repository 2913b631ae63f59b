"""Shared by all commands: options, exit codes, errors in one line, files of the project.

`remote.py` is shared by the clients of a running service, `terminal.py` prints tables and progress.
"""

import json
import math
import os
import shlex
import sys
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager, nullcontext, redirect_stdout
from dataclasses import fields, is_dataclass
from datetime import date
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final, cast

import typer
from gaitd_names import ExitCode
from gaitd_program import CommandError
from gaitd_toml import COMMAND_LINE, ConfigError

from daemon.config.shipped import configs_folder

CONFIG_VARIABLE: Final = "GAITD_CONFIG"
"""Environment variable in place of --config."""

ConfigFile = Annotated[
    Path,
    typer.Option(
        "--config", envvar=CONFIG_VARIABLE, help="trainer file of the service", dir_okay=False
    ),
]
Recorded = Annotated[
    Path,
    typer.Argument(metavar="IN", help="a .csv, a folder of `gaitd record`, or a ring of records"),
]
JSON: Final = "--json"
JsonOption = Annotated[
    bool, typer.Option(JSON, help="the result as one JSON document on stdout, text on stderr")
]
JsonLinesOption = Annotated[
    bool, typer.Option(JSON, help="one JSON document a line on stdout for each event")
]


@contextmanager
def errors_in_one_line(*errors: type[Exception], code: int = ExitCode.USAGE) -> Generator[None]:
    """End the command with `code` for `errors`, with 2 for an unusable file.

    Raises:
        CommandError: one of them happened.
    """
    try:
        yield
    except errors as error:
        raise CommandError(str(error), code) from error
    except BrokenPipeError:
        raise  # the reader of the output has ended; the command line then ends quietly
    except OSError as error:
        file = str(error.filename)
        raise CommandError(f"{file}: {error.strerror}", ExitCode.USAGE, blame=file) from error


@contextmanager
def json_on_stdout(wanted: bool) -> Generator[Callable[[object], None]]:
    """With --json, let text go to stderr, and to stdout only what the yielded function is given.

    Each value is one line of JSON. Without --json the function does nothing.
    """
    out = sys.stdout

    def write(value: object) -> None:
        if wanted:
            print(json_text(value), file=out, flush=True)

    with redirect_stdout(sys.stderr) if wanted else nullcontext():
        yield write


def json_text(value: object) -> str:
    """A result as JSON: named tuples and dataclasses are objects, not finite numbers null."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False)


def failure(error: CommandError | ConfigError, command: str) -> dict[str, object]:
    """An error as it is printed with --json."""
    if isinstance(error, CommandError):
        text = str(error)
        return {
            "error": text,
            # The errors of files begin with the file's name.
            "blame": error.blame or (text.partition(": ")[0] if ": " in text else command),
            "next": error.following,
            "exit_code": error.code,
        }
    all_of_it = [
        {"file": one.file, "key": one.key, "value": str(one.value), "allowed": one.allowed}
        for one in (error, *error.more)
    ]
    following = "gaitd check" if error.following is None else error.following
    if error.file == COMMAND_LINE:
        following = f"gaitd {command} --help"
    elif following:
        following = with_config(following)
    return {
        "error": str(error),
        "blame": f"{error.file}: {error.key}" if error.key else error.file,
        "next": following,
        "exit_code": ExitCode.USAGE,
        "errors": all_of_it,
    }


def with_config(command: str) -> str:
    """A command to give next, with the trainer file of this command line; empty without one."""
    words = [part for word in sys.argv[1:] for part in word.split("=", 1)]
    named = [value for option, value in pairwise(words) if option == "--config"]
    file = named[-1] if named else os.environ.get(CONFIG_VARIABLE, "")
    return f"{command} --config {shlex.quote(file)}" if file else ""


def _plain(value: object) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        return {one.name: _plain(getattr(value, one.name)) for one in fields(value)}
    match value:
        case dict():
            members = cast("dict[Any, Any]", value)
            return {str(name): _plain(member) for name, member in members.items()}
        case tuple() | list():
            names: tuple[str, ...] | None = getattr(value, "_fields", None)
            parts = [_plain(member) for member in cast("tuple[Any, ...]", value)]
            return dict(zip(names, parts, strict=True)) if names else parts
        case float():
            return value if math.isfinite(value) else None
        case Enum():
            return _plain(value.value)
        case str() | int() | None:
            return value
        case Path() | date():
            return str(value)
        case _:
            # An array or a number of numpy, which no other command imports for this.
            return _plain(cast("Any", value).tolist())


def full_name(word: str, known: Iterable[str], argument: str) -> str:
    """Return the one known name that a word means, as `hip` means right/hip where it is unique.

    Args:
        word: a name, or its end.
        known: names whose parts are separated by `/`.
        argument: of the command line, for the error.

    Returns: the name; the word itself if it is the end of none.

    Raises:
        ConfigError: it is the end of several.
    """
    found = [name for name in known if f"/{name}".endswith(f"/{word}")]
    if len(found) > 1:
        raise ConfigError(COMMAND_LINE, argument, word, f"one of {', '.join(found)}")
    return found[0] if found else word


def robot_file(robot: Path | None, shipped: str) -> Path:
    """Return the robot file of the command line, by default one of those that are shipped."""
    return robot or configs_folder("--robot", shipped) / shipped
