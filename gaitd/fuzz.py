"""`gaitd fuzz`: random commands and faults on the virtual machine, with invariants checked."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from daemon.config.strict import COMMAND_LINE, ConfigError
from gaitd.command_line import EXIT_FAILED, DemoFile, JsonOption, demo_file, json_on_stdout


def command(
    minutes: Annotated[float, typer.Option(min=0.05, help="of simulated time")] = 5.0,
    seed: Annotated[int, typer.Option(min=0, help="of the first session")] = 0,
    session_minutes: Annotated[float, typer.Option(min=0.05, help="of one session")] = 5.0,
    processes: Annotated[int, typer.Option(min=1, help="that share the sessions")] = 1,
    output: Annotated[
        Path | None, typer.Option(metavar="DIR", help="write random_hour.md there", file_okay=False)
    ] = None,
    config: DemoFile = None,
    as_json: JsonOption = False,
) -> None:
    """Fuzz the service in lock-step until the time is over, or an invariant is broken.

    No part of the service runs in real time. Each session has the seed after the one before, and
    with it another make of drives, another guidance, or an empty machine. Exit code 0 only if no
    invariant was broken; otherwise the last seconds and the command that repeats them are printed.
    """
    from gaitd_lab.fuzz.report import description, page, rerun, summary
    from gaitd_lab.fuzz.series import sessions
    from gaitd_lab.fuzz.tally import Tally

    trainer = demo_file(config)
    if trainer.name != "demo.toml":
        raise ConfigError(COMMAND_LINE, "--config", str(trainer), "a demo.toml, with its folder")
    tally = Tally()
    for played in sessions(trainer.parent, seed, minutes * 60, session_minutes * 60, processes):
        tally.add(played.tally)
        made = f"seed {played.seed}, {played.variant}: {played.tally.simulated_s:.0f} s"
        violations = len(played.tally.broken) or "none"
        print(f"{made}, violations {violations}", file=sys.stderr, flush=True)
        if output is not None:  # after each session: a run that is cut short leaves its page, too
            output.mkdir(parents=True, exist_ok=True)
            run = " ".join(("gaitd", *sys.argv[1:]))
            (output / "random_hour.md").write_text(page(tally, run), encoding="utf-8")
    with json_on_stdout(as_json) as write:
        for broken in tally.broken:
            print(description(broken))
        print(summary(tally))
        again = [rerun(broken) for broken in tally.broken]
        write({"passed": not tally.broken, "again": again, "tally": tally})
    raise typer.Exit(EXIT_FAILED if tally.broken else 0)
