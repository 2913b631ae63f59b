"""`gaitd core`: the process that owns the CAN bus, the cycle and safety."""

import os
import sys
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer


def command(
    config: Annotated[Path, typer.Option("--config", help="trainer file", dir_okay=False)],
) -> None:
    """The core alone; `gaitd run` starts it together with the gateway."""
    # Before numpy and scipy are loaded: each would start threads, and the real-time thread could
    # come to wait for one that has no priority. Our largest matrix is 8 by 24.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    from daemon.core.process import run_core
    from daemon.journal import SOCKET, Journal, is_journal
    from daemon.preflight.judgement import accepted

    settings = accepted(config)
    in_journal = is_journal(os.environ.get("JOURNAL_STREAM"), sys.stderr.fileno())
    with closing(Journal("gaitd-core", SOCKET if in_journal else None)) as log:
        raise typer.Exit(run_core(settings, os.environ.get("NOTIFY_SOCKET"), log))
