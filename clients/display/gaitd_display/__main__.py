"""The command `gaitd-display`: the three servers, and the hash of a password."""

import getpass
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import typer
from gaitd_client import ClientError, Clock, MonotonicClock, Trainer
from gaitd_names import ExitCode
from gaitd_program import CommandError, parser, run
from gaitd_toml import ConfigError
from starlette.types import ASGIApp

from gaitd_display.engineer import EngineerServer
from gaitd_display.login import PasswordError, hash_password
from gaitd_display.patient import PatientServer
from gaitd_display.settings import (
    EngineerSettings,
    Link,
    PatientSettings,
    TherapistSettings,
    Web,
    read_settings,
    refuse_certificate,
)
from gaitd_display.therapist import TherapistServer
from gaitd_display.web import serve

app: Final = parser("gaitd-display", "Pages for the people around a gait trainer.")


def _add(kind: str) -> None:
    """Add the command that serves the page of one kind of reader."""

    @app.command(kind, help=f"Serve the {kind}'s page.")
    def serve_page(
        config: Annotated[
            Path, typer.Option("--config", help="settings of the page", dir_okay=False)
        ],
    ) -> None:
        try:
            made = server_of(kind, config, MonotonicClock(), utc_ahead_ns)
        except (PasswordError, ClientError) as error:
            raise ConfigError(config, "", "", str(error), following="") from error
        refuse_certificate(config, made.web)
        serve(made.app, made.web)


for _kind in ("patient", "therapist", "engineer"):
    _add(_kind)


@app.command("password")
def print_hash() -> None:
    """Read a password, print its hash for the file."""
    password = getpass.getpass("password: ")
    if sys.stdin.isatty() and getpass.getpass("again: ") != password:
        raise CommandError("the two are different; nothing was made", ExitCode.USAGE)
    print(f'password_hash = "{hash_password(password)}"')


class Made(NamedTuple):
    """A server that does not run yet."""

    trainer: Trainer
    """Its connection, which is made when the server starts."""
    app: ASGIApp
    web: Web


def server_of(kind: str, file: Path, clock: Clock, utc_ahead_ns: Callable[[], int]) -> Made:
    """Return a server as its file says.

    Args:
        kind: patient, therapist or engineer.
        file: its settings.
        clock: measures silence, and the times of a session. That of a login is the computer's.
        utc_ahead_ns: returns UTC less the time of `clock`.

    Raises:
        ConfigError: a file, or the profile of a session, that cannot be used.
        PasswordError: the hash of a password that cannot be used.
        ClientError: credentials that cannot be used.
    """

    def trainer_of(link: Link) -> Trainer:
        return Trainer(
            link.endpoint,
            link.read_credentials(),
            trainer=link.trainer,
            client=f"gaitd-display {kind}",
            clock=clock,
            keep_trying=True,
        )

    if kind == "patient":
        patient = read_settings(file, PatientSettings)
        trainer = trainer_of(patient.trainer)
        return Made(trainer, PatientServer(patient, trainer, clock).app, patient.web)
    if kind == "therapist":
        therapist = read_settings(file, TherapistSettings)
        trainer = trainer_of(therapist.trainer)
        server = TherapistServer(therapist, trainer, MonotonicClock())
        return Made(trainer, server.app, therapist.web)
    engineer = read_settings(file, EngineerSettings)
    trainer = trainer_of(engineer.trainer)
    return Made(trainer, EngineerServer(engineer, trainer, utc_ahead_ns).app, engineer.web)


def utc_ahead_ns() -> int:
    """Return UTC less monotonic time of this computer."""
    return time.time_ns() - time.monotonic_ns()


def main() -> None:
    """Entry point of the script."""
    run(app, {PasswordError: ExitCode.USAGE})


if __name__ == "__main__":
    main()
