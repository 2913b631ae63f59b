"""`gaitd demo`: virtual drives, service and a scripted patient, live; a judgement at the end.

`gaitd_lab/demonstration/` holds the acts, the view and the checks.
"""

import signal
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from gaitd_names import ExitCode

from gaitd.command_line import CommandError, JsonOption, json_on_stdout
from gaitd.terminal import show

if TYPE_CHECKING:
    from gaitd_lab.demonstration.performance import Act
    from gaitd_lab.demonstration.training import Training
    from gaitd_lab.demonstration.view import Moment

SHORTEST_S = 6.0
GAIT_S, TIRING_S = 55.0, 120.0
"""Movement by default, without and with `--tiring`."""
SESSION_PACE = "1.5"
"""Pace of a session with a scripted patient alone: it takes less than a minute."""
PICTURE = Path("out") / "demo.png"
PRINT_EVERY_S = 1.0
DRAW_EVERY_S = 0.25
READ_S = 3.0
"""Time to read the addresses before the live view takes the terminal."""


def command(
    seconds: Annotated[
        float | None,
        typer.Option(
            min=SHORTEST_S,
            help="of movement, 55 by default (120 with --tiring): 25 for the paper's experiment"
            " (left out below 40), the rest is gait",
        ),
    ] = None,
    headless: Annotated[bool, typer.Option("--headless", help="plain lines, no live view")] = False,
    plot: Annotated[
        Path, typer.Option(metavar="PNG", help="where the picture goes; none of --session")
    ] = PICTURE,
    pace: Annotated[
        str | None,
        typer.Option(
            help="of simulated time: a multiple of real time, or max; by default 1, and"
            f" {SESSION_PACE} for a --session without --hands-on"
        ),
    ] = None,
    wall_clock: Annotated[
        bool, typer.Option("--wall-clock", help="by the computer's clock: shows its lateness")
    ] = False,
    engineer_port: Annotated[
        int,
        typer.Option(
            min=0, max=65535, help="of the engineer's page, or the next free one; 0: no page"
        ),
    ] = 8090,
    pages: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            exists=True,
            file_okay=False,
            help="of your own pages, which the engineer's server serves at /pages/",
        ),
    ] = None,
    tiring: Annotated[
        bool,
        typer.Option(
            "--tiring",
            help="instead: a patient who tires, without and with help as needed (clients/assist)",
        ),
    ] = False,
    session: Annotated[
        bool,
        typer.Option(
            "--session",
            help="instead: a training session of three short blocks, on the pages of patient and"
            " therapist (clients/display)",
        ),
    ] = False,
    two_legs: Annotated[
        bool, typer.Option("--two-legs", help="with both legs of configs/two_legs.toml")
    ] = False,
    hands_on: Annotated[
        bool,
        typer.Option("--hands-on", help="of --session: press the patient's buttons yourself"),
    ] = False,
    patient_port: Annotated[
        int, typer.Option(min=1, max=65535, help="of the patient's page, or the next free one")
    ] = 8080,
    therapist_port: Annotated[
        int, typer.Option(min=1, max=65535, help="of the therapist's page, or the next free one")
    ] = 8443,
    as_json: JsonOption = False,
) -> None:
    """Play gait without and with the patient, then the paper's experiment; check the errors.

    Or play a training session, and check that it was walked.
    """
    from daemon.config.shipped import configs_folder
    from gaitd_lab.demonstration.clients import find_page
    from gaitd_lab.demonstration.performance import Performance
    from gaitd_lab.demonstration.picture import draw
    from gaitd_lab.demonstration.report import as_object, tables
    from gaitd_lab.processes import Tempo

    file = "two_legs.toml" if two_legs else "demo.toml"
    trainer = configs_folder("configs", file) / file
    # SIGTERM ends it like Ctrl-C, in order.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    _refuse(pace, wall_clock=wall_clock, tiring=tiring, session=session, hands_on=hands_on)
    _refuse_two_legs(two_legs, tiring=tiring, session=session)
    engineer = find_page("engineer", engineer_port) if engineer_port else None
    with json_on_stdout(as_json) as write:
        if engineer:
            print(engineer.said, flush=True)
        training = _training(patient_port, therapist_port, hands_on) if session else None
        acts = [training.act()] if training else _acts(trainer, seconds, is_tiring=tiring)
        is_headless = headless or as_json or not sys.stdout.isatty()
        if training and not is_headless:
            time.sleep(READ_S)
        tempo = Tempo(pace or (SESSION_PACE if session and not hands_on else "1"), wall_clock)
        with _lines() if is_headless else _live_view() as screen:
            results = Performance(
                trainer,
                tempo,
                screen,
                pages=training.shown if training else engineer.shown if engineer else "",
                engineer_port=engineer.port if engineer else None,
                own_pages=pages,
            ).play(acts)
        picture = None if session else plot.resolve()
        if picture:
            picture.parent.mkdir(parents=True, exist_ok=True)
            draw(results, picture)
        trained = training.result if training else None
        show(table.texts() for table in tables(results, trained))
        passed = results.passed
        good, bad = "all within bounds, no stop", "not all within bounds"
        if training:
            passed = not results.trouble and trained is not None and trained.passed
            good = f"{len(trained.blocks) if trained else 0} blocks walked, no interruption"
            bad = "not walked as planned"
        said = good if passed else results.trouble or bad
        typer.secho(said, fg="green" if passed else "red", bold=True)
        if picture:
            print(f"picture: {picture}")
        write({"passed": passed, **as_object(results, trained), "picture": picture})
    raise typer.Exit(ExitCode.DONE if passed else ExitCode.FAILED)


def _refuse(
    pace: str | None, *, wall_clock: bool, tiring: bool, session: bool, hands_on: bool
) -> None:
    from gaitd_toml import COMMAND_LINE, ConfigError

    from sim_drives.time.server import parse_pace

    if pace is not None:
        try:
            parse_pace(pace)
        except ValueError as error:
            raise ConfigError(COMMAND_LINE, "--pace", pace, str(error)) from error
        if wall_clock:
            raise ConfigError(COMMAND_LINE, "--pace", pace, "nothing with --wall-clock")
    if tiring and session:
        raise ConfigError(COMMAND_LINE, "--session", "given", "nothing with --tiring")
    if hands_on and not session:
        raise ConfigError(COMMAND_LINE, "--hands-on", "given", "with --session alone")


def _refuse_two_legs(two_legs: bool, *, tiring: bool, session: bool) -> None:
    from gaitd_toml import COMMAND_LINE, ConfigError

    if two_legs and (tiring or session):
        other = "--tiring" if tiring else "--session"
        raise ConfigError(COMMAND_LINE, "--two-legs", "given", f"nothing with {other}")


def _acts(trainer: Path, seconds: float | None, *, is_tiring: bool) -> "list[Act]":
    from gaitd_lab.demonstration.performance import Act
    from gaitd_lab.demonstration.script import gait_act, paper_act, plan_of, tiring_act
    from gaitd_lab.demonstration.stage import empty_edits

    if is_tiring:
        half_s = (seconds or TIRING_S) / 2
        return [Act(partial(tiring_act, duration_s=half_s, helped=one)) for one in (False, True)]
    plan = plan_of(seconds or GAIT_S)
    gait = Act(partial(gait_act, plan=plan))
    if not plan.paper_s:
        print("The paper's experiment is left out: it wants 40 seconds or more.")
        return [gait]
    return [gait, Act(partial(paper_act, duration_s=plan.paper_s), empty_edits(trainer))]


def _training(patient_port: int, therapist_port: int, is_hands_on: bool) -> "Training":
    """Find ports, and tell where the pages of a session are."""
    from gaitd_lab.demonstration.clients import find_page
    from gaitd_lab.demonstration.training import Training

    patient, therapist = find_page("patient", patient_port), find_page("therapist", therapist_port)
    if patient.port is None or therapist.port is None:
        raise CommandError(patient.said, ExitCode.FAILED)
    training = Training(patient.port, therapist.port, is_hands_on=is_hands_on)
    print(patient.said)
    print(f"{therapist.said}   password: {training.password}", flush=True)
    return training


@contextmanager
def _live_view() -> "Generator[Callable[[Moment], None]]":
    """Take the terminal inside the context; yields a function that draws now and then."""
    from rich.live import Live

    from gaitd_lab.demonstration.view import picture

    drawn_s = 0.0
    with Live(screen=True, auto_refresh=False) as live:

        def draw(moment: "Moment") -> None:
            nonlocal drawn_s
            if time.monotonic() - drawn_s >= DRAW_EVERY_S:
                drawn_s = time.monotonic()
                live.update(picture(moment, *live.console.size), refresh=True)

        yield draw


@contextmanager
def _lines() -> "Generator[Callable[[Moment], None]]":
    """Yield a function that prints each scene's title, and the values about once a second."""
    from gaitd_lab.demonstration.report import line

    printed_s, title = 0.0, ""

    def tell(moment: "Moment") -> None:
        nonlocal printed_s, title
        if moment.scene.title != title:
            title = moment.scene.title
            print(f"--- {title}", flush=True)
        if time.monotonic() - printed_s >= PRINT_EVERY_S:
            printed_s = time.monotonic()
            print(line(moment), flush=True)

    yield tell
