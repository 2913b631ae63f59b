"""The command line: `COMMANDS` is the table of all commands; only the chosen one is imported.

`gaitd NAME` imports the file of its row and runs the function `command`, or in the file of a family
the function with the command's name. typer reads the options from its signature.
In every command a configuration error is one line on stderr and exit code 2.
"""

import importlib
import os
import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Annotated, Final, cast

import typer

from daemon.config.strict import ConfigError

EXIT_CONFIGURATION: Final = 2

COMMANDS: Final = {
    "run": ("run", "The service: core and gateway."),
    "core": ("core", "The real-time half of the service alone."),
    "gateway": ("gateway", "The other half: Zenoh, events, black box."),
    "check": ("check", "Validate a configuration, and print its values at the joint."),
    "scan": ("scan", "Nodes on a bus, compared with the configuration. Reads only."),
    "drive": ("drive", "One drive's objects: dump, compare, store, restore."),
    "sim": ("sim", "The virtual drives of a configuration, in real time."),
    "demo": ("demo", "Virtual drives, service and a scripted patient, with a live view."),
    "replay": ("replay", "The observer over a recorded file, as fast as it can."),
    "blackbox": ("blackbox", "Recordings around each stop, and the log of requests."),
    "experiment": ("experiment", "The paper's experiment on the empty virtual machine."),
    "delay": ("delay", "How much later than its row an effort acts, from a recording."),
    "baseline": ("baseline", "Estimated effort of a passive patient, recorded once."),
    "ablation": ("ablation", "Every choice of the observer on and off: errors compared."),
    "calibrate": ("calibrate", "Friction, springs and encoder noise of the empty machine."),
    "doctor": ("doctor", "What this machine can and cannot do for gaitd."),
    "consistency": ("consistency", "The observer's sigmas, gaps, rest and drift, checked."),
    "matrix": ("matrix", "Every fault in every mode on both axes, in lock-step, checked."),
    "fuzz": ("fuzz", "Random commands and faults in lock-step, with invariants checked."),
    "rig": ("rig", "Run a command where there is SocketCAN, or systemd."),
    "soak": ("soak", "An hour of gait by the real processes, with faults drawn from a seed."),
    "bench": ("bench", "The project's benchmarks."),
    "status": ("status", "The state of a running service."),
    "enable": ("control", "Let a running service enable its drives."),
    "disable": ("control", "Stop in an orderly way and switch the drives off."),
    "stop": ("control", "Stop now."),
    "reset": ("control", "Reset a latched stop once its cause is gone."),
    "commission": ("preparation", "Prove the sign of one axis of the empty machine."),
    "reference": ("preparation", "Home one axis of the empty machine."),
    "mode": ("control", "Choose what the enabled leg does: hold, gait, excite, hand_guiding."),
    "self-test": ("preparation", "The daily test: hand switch, emergency stop, each axis."),
    "plan": ("plan", "Limits within which a session may request a gait."),
    "keys": ("keys", "Clients that may connect: issue, list, renew, revoke."),
    "modes": ("modes", "Modes, requests and causes of stops as tables: docs/modes.md."),
}
"""File of this package and short help of each command, in the order of `gaitd --help`."""


def build(chosen: str | None) -> typer.Typer:
    """Build the whole command line; only the chosen command is imported, the others are stubs."""
    app = typer.Typer(
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        help="Drive service of a home gait trainer.",
    )
    app.callback()(_common)
    for name, (file, line) in COMMANDS.items():
        run = _function(file, name) if name == chosen else _not_chosen
        app.command(name, short_help=line)(run)
    return app


def main() -> None:
    """Entry point of the `gaitd` script."""
    chosen = next((word for word in _words()[1:] if word in COMMANDS), None)
    try:
        build(chosen)()
    except ConfigError as error:
        print(error.line, file=sys.stderr)
        sys.exit(EXIT_CONFIGURATION)


def _words() -> list[str]:
    """Arguments of this process, or those that a shell completes (from an environment variable)."""
    lines = (os.environ.get(name) for name in ("COMP_WORDS", "_TYPER_COMPLETE_ARGS"))
    return next((line.split() for line in lines if line), sys.argv)


def _function(file: str, name: str) -> Callable[..., None]:
    members = vars(importlib.import_module(f"gaitd.{file}"))
    return cast("Callable[..., None]", members.get("command") or members[name.replace("-", "_")])


def _not_chosen() -> None:
    raise AssertionError("typer runs only the command that was chosen")


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"gaitd {version('gaitd')}")
        raise typer.Exit


def _common(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    pass


if __name__ == "__main__":
    main()
