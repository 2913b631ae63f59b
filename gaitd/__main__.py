"""The command line: one short file per subcommand, of which only the chosen one is imported.

`gaitd NAME` imports `gaitd/NAME.py` (with an underscore for a dash) and runs its function
`command`, or the function with the file's own name. typer reads the options from its signature.
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
    "run": "The service: core and gateway.",
    "core": "The real-time half of the service alone.",
    "gateway": "The other half: Zenoh, events, black box.",
    "check": "Validate a configuration and say what it means at the joint.",
    "scan": "Who is on a bus, and is it the machine of the configuration. Reads only.",
    "drive": "One drive's objects: dump, compare, store, restore.",
    "sim": "The virtual drives of a configuration, in real time.",
    "demo": "Virtual drives, service and a scripted patient; a live view; the errors at the end.",
    "replay": "The observer over a recorded file, as fast as it can.",
    "blackbox": "What was kept around each stop, and who asked for what.",
    "experiment": "The paper's experiment on the empty virtual machine: figures and numbers.",
    "delay": "How much later than its row an effort acts, measured from a recording.",
    "baseline": "What is taken for a patient while one only lies there, recorded once.",
    "ablation": "Every choice of the observer on and off: errors beside each other.",
    "calibrate": "Friction, springs and encoder noise from recordings of the empty machine.",
    "doctor": "What this machine can and cannot do for gaitd.",
    "honesty": "Whether what the observer says of itself is true: sigmas, gaps, rest, drift.",
    "matrix": "Every fault in every mode on both axes, in lock-step: is what happens right.",
    "torture": "Random commands and faults in lock-step, watched by invariants.",
    "rig": "Run a command where there is SocketCAN, or a systemd, though this machine has none.",
    "soak": "An hour of gait by the real processes, with faults drawn from a seed.",
    "bench": "The project's benchmarks.",
    "status": "What a running service does.",
    "enable": "Let a running service enable its drives.",
    "disable": "Stop in an orderly way and switch the drives off.",
    "stop": "Stop now.",
    "reset": "Reset a latched stop once its cause is gone.",
    "commission": "Prove the sign of one axis of the empty machine, before anything is enabled.",
    "reference": "Home one axis of the empty machine.",
    "mode": "Choose what the enabled leg does: hold, gait, excite, hand_guiding, self_test.",
    "self-test": "The test of the day, step by step: hand switch, emergency stop, each axis.",
    "modes": "The modes, requests and causes of stops as tables; written into docs/modes.md.",
}
"""Commands in the order of `gaitd --help`. Each name is a file of this package."""


def build(chosen: str | None) -> typer.Typer:
    """Build the whole command line; only the chosen command is imported, the others are stubs."""
    app = typer.Typer(
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        help="Drive service of a home gait trainer.",
    )
    app.callback()(_common)
    for name, line in COMMANDS.items():
        app.command(name, short_help=line)(_function(name) if name == chosen else _only_a_name)
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


def _function(name: str) -> Callable[..., None]:
    name = name.replace("-", "_")
    members = vars(importlib.import_module(f"gaitd.{name}"))
    return cast("Callable[..., None]", members.get("command") or members[name])


def _only_a_name() -> None:
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
