"""Option parser, errors and the end of a program."""

import sys
from collections.abc import Mapping
from importlib.metadata import version
from types import MappingProxyType
from typing import Annotated, NoReturn

import typer
from gaitd_names import ExitCode
from gaitd_toml import ConfigError
from typer.core import TyperGroup


class CommandError(Exception):
    """The command ends without its result: one line on stderr, a JSON document with --json."""

    def __init__(self, text: str, code: int, *, blame: str = "", following: str = "") -> None:
        """`blame` is the file, option or part at fault, `following` the command to give next."""
        self.code, self.blame, self.following = code, blame, following
        super().__init__(text)


def parser(distribution: str, purpose: str, cls: type[TyperGroup] = TyperGroup) -> typer.Typer:
    """Return the option parser of a program, to which its commands are added.

    Args:
        distribution: named like the program; its version is that of `--version`.
        purpose: first line of `--help`.
        cls: how a command is found.
    """
    app = typer.Typer(
        cls=cls,
        no_args_is_help=True,
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
        help=purpose,
    )

    def print_version(wanted: bool) -> None:
        if wanted:
            print(f"{distribution} {version(distribution)}")
            raise typer.Exit

    @app.callback()
    def common(
        version: Annotated[
            bool,
            typer.Option(
                "--version", help="Print the version.", callback=print_version, is_eager=True
            ),
        ] = False,
    ) -> None:
        pass

    return app


def run(
    app: typer.Typer, codes: Mapping[type[Exception], ExitCode] = MappingProxyType({})
) -> NoReturn:
    """Run a program of this process's words; an error is one line on stderr, and an exit code.

    Args:
        app: the program.
        codes: exit code of each further kind of error, where the nearest base class counts.

    Raises:
        SystemExit: always, with an `ExitCode`, or 130 after Ctrl-C.
    """
    try:
        sys.exit(app())
    except ConfigError as error:
        text, code = error.lines, ExitCode.USAGE
    except CommandError as error:
        text, code = str(error), error.code
    except tuple(codes) as error:
        text = str(error)
        code = next(codes[kind] for kind in type(error).__mro__ if kind in codes)
    except OSError as error:
        text, code = f"{error.filename}: {error.strerror}", ExitCode.USAGE
    print(text, file=sys.stderr)
    sys.exit(code)
