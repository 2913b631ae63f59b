"""The command `gaitd-display`: the three servers, and the hash of a password."""

import argparse
import getpass
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from gaitd_client import ClientError, Clock, MonotonicClock, Trainer
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

CONFIGURATION_ERROR: Final = 2
SERVERS: Final = ("patient", "therapist", "engineer")


def main() -> None:
    """Run the command; exit code 2 for a file that cannot be used."""
    parser = argparse.ArgumentParser(prog="gaitd-display", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    for name in SERVERS:
        command = commands.add_parser(name, help=f"serve the {name}'s page")
        command.add_argument("--config", type=Path, required=True, metavar="FILE")
    commands.add_parser("password", help="read a password, print its hash for the file")
    given = parser.parse_args()
    try:
        if given.command == "password":
            _print_hash()
        else:
            made = server_of(given.command, given.config, MonotonicClock(), utc_ahead_ns)
            refuse_certificate(given.config, made.web)
            serve(made.app, made.web)
    except ConfigError as error:
        _refuse(error, *error.more)
    except (PasswordError, ClientError) as error:
        _refuse(f"{given.config}: {error}" if given.command in SERVERS else error)


def _refuse(*errors: object) -> NoReturn:
    print(*(f"gaitd-display: {error}" for error in errors), sep="\n", file=sys.stderr)
    sys.exit(CONFIGURATION_ERROR)


class Made(NamedTuple):
    """A server that does not run yet."""

    trainer: Trainer
    """Its connection, which is made when the server starts."""
    app: ASGIApp
    web: Web


def server_of(kind: str, file: Path, clock: Clock, utc_ahead_ns: Callable[[], int]) -> Made:
    """Return a server as its file says.

    Args:
        kind: one of `SERVERS`.
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


def _print_hash() -> None:
    password = getpass.getpass("password: ")
    if sys.stdin.isatty() and getpass.getpass("again: ") != password:
        raise PasswordError("the two are different; nothing was made")
    print(f'password_hash = "{hash_password(password)}"')


if __name__ == "__main__":
    main()
