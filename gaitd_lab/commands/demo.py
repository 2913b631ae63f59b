"""`gaitd demo`: virtual drives, service and a scripted patient, live; a judgement at the end.

`gaitd_lab/demonstration/` holds the scenes, the view and the checks.
"""

import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gaitd.command_line import EXIT_FAILED, CommandError, JsonOption, json_on_stdout

if TYPE_CHECKING:
    from gaitd_lab.demonstration.pages import PageSpot
    from gaitd_lab.demonstration.performance import Performance
    from gaitd_lab.demonstration.picture import Results
    from gaitd_lab.demonstration.script import Scene
    from gaitd_lab.demonstration.training import TrainingPlan
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
    from gaitd_lab.demonstration.pages import find_page
    from gaitd_lab.demonstration.performance import Performance
    from gaitd_lab.demonstration.picture import draw
    from gaitd_lab.demonstration.report import as_object, report
    from gaitd_lab.demonstration.script import plan_of, tiring_plan
    from gaitd_lab.processes import Tempo

    configs = configs_folder("configs", "demo.toml")
    # SIGTERM ends it like Ctrl-C, in order.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    _refuse(pace, wall_clock=wall_clock, tiring=tiring, session=session, hands_on=hands_on)
    plan = tiring_plan(seconds or TIRING_S) if tiring else plan_of(seconds or GAIT_S)
    engineer = find_page("engineer", engineer_port) if engineer_port else None
    with json_on_stdout(as_json) as write:
        if engineer:
            print(engineer.said, flush=True)
        training = None
        if session:
            patient, therapist = (
                find_page("patient", patient_port),
                find_page("therapist", therapist_port),
            )
            training = _training(patient, therapist, is_hands_on=hands_on)
        is_headless = headless or as_json or not sys.stdout.isatty()
        if training and not is_headless:
            time.sleep(READ_S)
        tempo = Tempo(pace or (SESSION_PACE if session and not hands_on else "1"), wall_clock)
        performance = Performance(configs, plan, tempo, engineer, training)
        results = performance.play(_Lines()) if is_headless else _watch(performance)
        picture = None if session else plot.resolve()
        if picture:
            picture.parent.mkdir(parents=True, exist_ok=True)
            draw(results, picture)
        report(results, plan)
        if picture:
            print(f"picture: {picture}")
        write(as_object(results) | {"picture": picture})
    raise typer.Exit(0 if results.passed else 1)


def _refuse(
    pace: str | None, *, wall_clock: bool, tiring: bool, session: bool, hands_on: bool
) -> None:
    from daemon.config.strict import COMMAND_LINE, ConfigError
    from sim_drives.time.server import parse_pace

    if pace is not None:
        try:
            parse_pace(pace)
        except ValueError as error:
            raise ConfigError(COMMAND_LINE, "--pace", pace, str(error)) from error
        if wall_clock:
            raise ConfigError(COMMAND_LINE, "--pace", pace, "nothing with --wall-clock")
        if tiring:
            # The controller answers by the computer's time: a setpoint older than 100 ms is refused
            raise ConfigError(COMMAND_LINE, "--pace", pace, "nothing with --tiring")
    if tiring and session:
        raise ConfigError(COMMAND_LINE, "--session", "given", "nothing with --tiring")
    if hands_on and not session:
        raise ConfigError(COMMAND_LINE, "--hands-on", "given", "with --session alone")


def _training(patient: "PageSpot", therapist: "PageSpot", *, is_hands_on: bool) -> "TrainingPlan":
    """Draw the password, and tell where the pages of a session are."""
    from gaitd_lab.demonstration.training import TrainingPlan, new_password

    if patient.port is None or therapist.port is None:
        raise CommandError(patient.said, EXIT_FAILED)
    password = new_password()
    print(patient.said)
    print(f"{therapist.said}   password: {password}", flush=True)
    return TrainingPlan(patient.port, therapist.port, password, is_hands_on)


def _watch(performance: "Performance") -> "Results":
    from rich.live import Live

    from gaitd_lab.demonstration.view import picture

    with Live(screen=True, auto_refresh=False) as live:

        class Pictures:
            """Live view, redrawn at most once per `DRAW_EVERY_S`."""

            drawn_s = 0.0

            def show(self, moment: "Moment") -> None:
                if time.monotonic() - self.drawn_s >= DRAW_EVERY_S:
                    self.drawn_s = time.monotonic()
                    live.update(picture(moment, *live.console.size), refresh=True)

            def scene(self, scene: "Scene") -> None:
                """Do nothing: the next picture shows the scene."""

        return performance.play(Pictures())


class _Lines:
    """Plain output: each scene's title, and about one line per second of the current values."""

    def __init__(self) -> None:
        self._printed_s = 0.0

    def show(self, moment: "Moment") -> None:
        from gaitd_lab.demonstration.report import line

        if time.monotonic() - self._printed_s >= PRINT_EVERY_S:
            self._printed_s = time.monotonic()
            print(line(moment), flush=True)

    def scene(self, scene: "Scene") -> None:
        print(f"--- {scene.title}", flush=True)
