"""`gaitd core`: the process that owns the CAN bus, the cycle and safety."""

import os
import sys
from contextlib import ExitStack, closing, nullcontext
from typing import Annotated, Final

import typer

from gaitd.command_line import ConfigFile, JsonLinesOption, json_on_stdout

PART: Final = "core"


def command(
    config: ConfigFile,
    admit_simulated: Annotated[
        bool,
        typer.Option(
            "--admit-simulated",
            help="for rigs: a simulated bus under systemd; its server runs with --wall-clock",
        ),
    ] = False,
    as_json: JsonLinesOption = False,
) -> None:
    """Run the core alone; `gaitd run` starts it together with the gateway."""
    # Set before numpy and scipy are loaded. Each would start threads, and the real-time thread
    # could wait for one without priority. The largest matrix here is 8 by 24.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    from gaitd_toml import ConfigError

    from daemon.config.trainer import SIMULATED, read_trainer
    from daemon.ipc import starting
    from daemon.system.journal import SOCKET, Journal, is_journal
    from daemon.system.lock import hold

    in_journal = is_journal(os.environ.get("JOURNAL_STREAM"), sys.stderr.fileno())
    file, errors = read_trainer(config)
    with ExitStack() as held, closing(Journal("gaitd-core", SOCKET if in_journal else None)) as log:
        begun = held.enter_context(
            nullcontext(lambda: None) if errors else starting.said(file.runtime)
        )
        if not errors:
            # Before all that takes seconds: another core, or a directory that cannot be used.
            held.enter_context(hold(config, "paths.runtime", file.runtime, PART))
            held.enter_context(hold(config, "paths.state", file.state, PART))
        from daemon.core.runtime.process import run_core
        from daemon.preflight.acceptance import accepted

        settings = accepted(config)
        has_watchdog = "WATCHDOG_USEC" in os.environ
        if has_watchdog and settings.trainer.bus.interface == SIMULATED and not admit_simulated:
            allowed = (
                "a real bus: a watchdog goes by the computer's clock "
                "(a desk has the drop-in bus-simulated.conf)"
            )
            raise ConfigError(config, "bus.interface", SIMULATED, allowed, following="")
        address = os.environ.get("NOTIFY_SOCKET")
        with json_on_stdout(as_json) as write:
            write({"event": "started", "part": PART, "pid": os.getpid()})
            code = run_core(settings, address, log, begun, has_watchdog=has_watchdog)
            write({"event": "ended", "part": PART, "exit_code": code})
        raise typer.Exit(code)
