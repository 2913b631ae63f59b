"""Shared by all commands: options, exit codes, errors in one line, files of the project.

`remote.py` is shared by the clients of a running service, `terminal.py` prints tables and progress.
"""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Final

import typer

from daemon.config.shipped import configs_folder

EXIT_FAILED: Final = 1
EXIT_REFUSED: Final = 2
"""Usage, configuration, or a file that cannot be read or written."""

CONFIG_VARIABLE: Final = "GAITD_CONFIG"
"""Environment variable in place of --config."""

ConfigFile = Annotated[
    Path,
    typer.Option(
        "--config", envvar=CONFIG_VARIABLE, help="trainer file of the service", dir_okay=False
    ),
]
DemoFile = Annotated[
    Path | None,
    typer.Option("--config", help="trainer file; by default configs/demo.toml", dir_okay=False),
]
Recorded = Annotated[Path, typer.Argument(metavar="IN", help="a .csv, or a ring of records")]


@contextmanager
def errors_in_one_line(*errors: type[Exception], code: int = EXIT_REFUSED) -> Generator[None]:
    """End the command with one line on stderr: `code` for `errors`, 2 for an unusable file."""
    try:
        yield
    except errors as error:
        print(error, file=sys.stderr)
        raise typer.Exit(code) from error
    except BrokenPipeError:
        raise  # the reader of the output has ended; the command line then ends quietly
    except OSError as error:
        print(f"{error.filename}: {error.strerror}", file=sys.stderr)
        raise typer.Exit(EXIT_REFUSED) from error


def demo_file(config: Path | None) -> Path:
    """Return the trainer file of the command line, by default the demonstration's."""
    return config or configs_folder("--config", "demo.toml") / "demo.toml"


def robot_file(robot: Path | None, shipped: str) -> Path:
    """Return the robot file of the command line, by default one of those that are shipped."""
    return robot or configs_folder("--robot", shipped) / shipped
