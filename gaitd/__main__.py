"""The command line: `COMMANDS` is the table of gaitd's commands; only the chosen one is imported.

`gaitd NAME` imports the module of its row and runs the function `command`, or in the file of a
family the function with the command's name. typer reads the options from its signature.
Other packages bring tables of their own by entry points, which are read for the help, and for a
command that gaitd does not have: what happens to be installed takes no part in the service.
In every command each configuration error is one line on stderr, and the exit code is 2. With --json
each error is also a JSON document on stdout.
"""

import errno
import importlib
import os
import sys
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any, Final, cast

import typer
from gaitd_names import ExitCode
from gaitd_program import parser
from gaitd_toml import ConfigError
from typer.core import TyperGroup
from typer.exceptions import TyperException

from gaitd import language
from gaitd.command_line import JSON, CommandError, failure, json_text

TOOLS: Final = "pip install ./clients/python '.[tools]'"
RECORDER: Final = "pip install ./clients/python '.[record]' ./clients/record"
FLEET: Final = "pip install ./clients/python '.[fleet,tools]'"
REMEDIES: Final = {
    **dict.fromkeys(("matplotlib", "scipy"), TOOLS),
    **dict.fromkeys(("gaitd_record", "mcap", "pyarrow"), RECORDER),
    **dict.fromkeys(("distributed", "duckdb"), FLEET),
}
"""Packages that the service does not need, and how each is installed."""

SERVICE: Final = "Service"
OPERATOR: Final = "Operator: requests to a running service"
COMMISSIONING: Final = "Commissioning of the empty machine"
DRIVES: Final = "Drives on a bus"
RECORDINGS: Final = "Recordings"

COMMANDS: Final = {
    "run": ("run", SERVICE, "The service: core and gateway."),
    "core": ("core", SERVICE, "The real-time half of the service alone."),
    "gateway": ("gateway", SERVICE, "The other half: Zenoh, events, black box."),
    "check": ("check", SERVICE, "Validate a configuration, and print its values at the joint."),
    "doctor": ("doctor", SERVICE, "What this machine can and cannot do for gaitd."),
    "keys": ("keys", SERVICE, "Clients that may connect: issue, list, renew, revoke."),
    "schema": ("schema", SERVICE, "The JSON Schema of a message."),
    "explain": ("explain", SERVICE, "A stop, a refusal or an event: meaning and remedy."),
    "status": ("status", OPERATOR, "The state of a running service."),
    "watch": ("watch", OPERATOR, "Messages of one key, as they come."),
    "wait": ("wait", OPERATOR, "Wait until the service is in a mode; for scripts."),
    "stop": ("control", OPERATOR, "Stop now."),
    "enable": ("control", OPERATOR, "Let a running service enable its drives."),
    "disable": ("control", OPERATOR, "Stop in an orderly way and switch the drives off."),
    "reset": ("control", OPERATOR, "Reset a latched stop once its cause is gone."),
    "mode": ("control", OPERATOR, "What the enabled leg does: hold, gait, torque, hand_guiding."),
    "self-test": ("preparation", OPERATOR, "Daily test: hand switch, emergency stop, each axis."),
    "plan": ("plan", OPERATOR, "Limits within which a session may request a gait."),
    "mark": ("control", OPERATOR, "Write a remark into events, recording and history."),
    "commission": (
        "preparation",
        COMMISSIONING,
        "Prove the sign of one axis; --report: accept each drive.",
    ),
    "reference": ("preparation", COMMISSIONING, "Home one axis."),
    "scan": ("scan", DRIVES, "Nodes on a bus, compared with the configuration. Reads only."),
    "drive": ("drive", DRIVES, "One drive's objects: dump, compare, store, restore."),
    "drive profile": ("drive_profile", DRIVES, "A drive profile proposed from a maker's EDS."),
    "drive verify": (
        "drive_verify",
        DRIVES,
        "One drive on a bench, played against its profile; the evidence in one signed file.",
    ),
    "drive evidence": ("drive_evidence", DRIVES, "Read such a file, and check its signature."),
    "record": ("record", RECORDINGS, "Record what a running service publishes."),
    "blackbox": ("blackbox", RECORDINGS, "Recordings around each stop, and the log of requests."),
    "replay": ("replay", RECORDINGS, "The observer over a recorded file, as fast as it can."),
    "calibrate": ("calibrate", RECORDINGS, "Friction, springs and encoder noise of the machine."),
    "baseline": ("baseline", RECORDINGS, "Estimated effort of a passive patient, recorded once."),
    "delay": ("delay", RECORDINGS, "How much later than its row an effort acts."),
    "import-candump": ("import_candump", RECORDINGS, "A recorded CAN bus as a recording."),
    "fleet": ("fleet", RECORDINGS, "Many recordings, on this computer or a cluster."),
}
"""File of this package, group and short help of each command, in the order of `gaitd --help`.

A name may be of two words; it comes before a command of the first word alone."""

ENTRY_POINTS: Final = "gaitd.commands"
"""Group of entry points: tables of other packages, with whole modules in place of files."""


def commands_for(chosen: str | None) -> dict[str, tuple[str, str, str]]:
    """Return all commands; those of other packages only if the chosen one is not of gaitd."""
    found = {name: (f"gaitd.{file}", group, line) for name, (file, group, line) in COMMANDS.items()}
    if chosen not in COMMANDS:
        for point in entry_points(group=ENTRY_POINTS):
            found |= point.load()
    return found


def build(chosen: str | None) -> typer.Typer:
    """Build the command line; only the chosen command is imported, the others are stubs."""
    app = parser("gaitd", "Drive service of a home gait trainer.", _Group)
    for name, (module, group, line) in commands_for(chosen).items():
        run = _function(module, name) if name == chosen else _not_chosen
        app.command(name, short_help=line, rich_help_panel=group)(run)
    return app


def main() -> None:
    """Entry point of the `gaitd` script."""
    language.choose(os.environ)
    words = _words()[1:]
    chosen = _chosen(words)
    # Behind `--` stand the words of another command, of `gaitd rig`.
    as_json = JSON in words[: words.index("--") if "--" in words else None]
    try:
        _refuse_unknown(chosen)
        # typer prints an error of usage itself, and not as JSON.
        code = cast("int | None", build(chosen)(standalone_mode=not as_json))
    except (ConfigError, CommandError) as error:
        lines = error.lines if isinstance(error, ConfigError) else str(error)
        code = _fail(lines, failure(error, chosen or ""), as_json=as_json)
    except TyperException as error:
        text = error.format_message()
        help_line = f"gaitd {chosen} --help" if chosen else "gaitd --help"
        usage = CommandError(text, ExitCode.USAGE, blame="command line", following=help_line)
        code = _fail(text, failure(usage, chosen or ""), as_json=as_json)
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        text = f"{error.filename}: too long for the name of a file"
        too_long = CommandError(text, ExitCode.USAGE, blame=str(error.filename))
        code = _fail(text, failure(too_long, chosen or ""), as_json=as_json)
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in REMEDIES:
            raise
        remedy = REMEDIES[package]
        text = f"gaitd {chosen} needs {package}: {remedy} in a clone of gaitd"
        lacking = CommandError(text, ExitCode.USAGE, blame=package, following=remedy)
        code = _fail(text, failure(lacking, chosen or ""), as_json=as_json)
    sys.exit(code or 0)


class _Group(TyperGroup):
    """All commands, with those of two words."""

    def resolve_command(  # typer does not export the types of its context and commands
        self,
        ctx: Any,  # noqa: ANN401
        args: list[str],
    ) -> tuple[str | None, Any, list[str]]:
        pair = " ".join(args[:2])
        if pair in self.commands:
            return pair, self.commands[pair], args[2:]
        return super().resolve_command(ctx, args)


def _chosen(words: list[str]) -> str | None:
    """The command of this command line."""
    named = [word for word in words if not word.startswith("-")]
    pair = " ".join(named[:2])
    return pair if pair in COMMANDS else next(iter(named), None)


def _refuse_unknown(chosen: str | None) -> None:
    """Say what to install where only gaitd is: the command may be one of the laboratory."""
    found = commands_for(chosen)
    # What a shell completes is no argument of this process, and need not be a command yet.
    if chosen not in sys.argv or chosen in found or found.keys() != COMMANDS.keys():
        return
    from daemon.config.trainer import LABORATORY, LABORATORY_BY

    text = (
        f"gaitd has no command {chosen}; those of the laboratory are in {LABORATORY}, which is"
        f" not installed: {LABORATORY_BY}"
    )
    raise CommandError(text, ExitCode.USAGE, blame=LABORATORY, following="gaitd --help")


def _fail(text: str, document: dict[str, object], *, as_json: bool) -> int:
    print(text, file=sys.stderr)
    if as_json:
        print(json_text(document))
    return cast("int", document["exit_code"])


def _words() -> list[str]:
    """Arguments of this process, or those that a shell completes (from an environment variable)."""
    lines = (os.environ.get(name) for name in ("COMP_WORDS", "_TYPER_COMPLETE_ARGS"))
    return next((line.split() for line in lines if line), sys.argv)


def _function(module: str, name: str) -> Callable[..., None]:
    members = vars(importlib.import_module(module))
    return cast("Callable[..., None]", members.get("command") or members[name.replace("-", "_")])


def _not_chosen() -> None:
    raise AssertionError("typer runs only the command that was chosen")


if __name__ == "__main__":
    main()
