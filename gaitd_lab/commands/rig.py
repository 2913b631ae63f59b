"""`gaitd rig NAME -- COMMAND`: run a command where there is SocketCAN, or systemd."""

import os
import shlex
import subprocess
import sys
import tempfile
import time
from enum import StrEnum
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Final

import typer
from gaitd_names import ExitCode

from gaitd.command_line import CommandError, JsonOption, json_on_stdout

if TYPE_CHECKING:
    from gaitd_lab.testing.rigs import Rig

POLL_S: Final = 0.1


class Name(StrEnum):
    """Environment of `gaitd rig`."""

    VCAN = "vcan"
    SYSTEMD = "systemd"


def command(
    name: Annotated[Name, typer.Argument(help="vcan: SocketCAN; systemd: systemd as PID 1")],
    words: Annotated[list[str], typer.Argument(help="command and arguments, behind `--`")],
    as_json: JsonOption = False,
) -> None:
    """Run a command in an environment with what this machine lacks: SocketCAN, or systemd as PID 1.

    The current folder may be written to, the rest of the disk is read-only.
    Where the kernel has SocketCAN, `vcan` is a network namespace of its own. Elsewhere it is a
    virtual machine, which takes half a minute to boot and computes about ten times slower.
    """
    from gaitd_lab.testing.rigs import RIGS

    rig = RIGS[name.value]
    lack = rig.lacks()
    if lack is not None:
        needs = "`make rigs` in a clone of gaitd installs it, as root on Debian"
        text = f"gaitd rig {name.value}: {lack} ({needs})"
        raise CommandError(text, ExitCode.USAGE, blame=name.value, following="make rigs")
    with (
        tempfile.TemporaryDirectory(prefix="gaitd-rig-") as folder,
        json_on_stdout(as_json) as write,
    ):
        code = _run(rig, name.value, words, Path(folder))
        write({"rig": name, "command": words, "exit_code": code})
    raise typer.Exit(code)


def _run(rig: "Rig", name: str, words: list[str], folder: Path) -> int:
    from gaitd_lab.testing.rigs import PATH, finished, prepare

    here = Path.cwd()
    lines = f"{rig.set_up}cd {shlex.quote(str(here))}\nexec {shlex.join(words)}"
    script, log, rig_log = prepare(lines, folder), folder / "log", folder / "rig"
    log.touch()
    with rig_log.open("wb") as output, log.open("rb") as log_file:
        running = subprocess.Popen(
            rig.command(script, folder, (here,)),
            stdin=subprocess.DEVNULL,
            env={**os.environ, "PATH": PATH},
            stdout=output,
            stderr=subprocess.STDOUT,
        )
        try:
            _show(running, name, log_file)
        finally:
            running.terminate()
            running.wait()
    over = finished(folder, rig_log.read_text(encoding="utf-8", errors="replace"))
    if over.exit_code < 0:
        text = f"gaitd rig {name}: it ended before the command\n{over.output}"
        raise CommandError(text, ExitCode.UNAVAILABLE, blame=name)
    return over.exit_code


def _show(running: subprocess.Popen[bytes], name: str, log_file: IO[bytes]) -> None:
    """Copy the command's output to stdout while it runs."""
    from rich.console import Console

    console = Console(stderr=True)
    out = sys.stdout.buffer
    with console.status(f"{name} starts") as status:
        while running.poll() is None:
            written = log_file.read()
            if written:
                status.stop()
                out.write(written)
                out.flush()
            time.sleep(POLL_S)
    out.write(log_file.read())
    out.flush()
