"""The command `gaitd-display`: the three servers, and the hash of a password."""

import argparse
import getpass
import sys
import time
from pathlib import Path
from typing import Final

from gaitd_client import ClientError, MonotonicClock, Trainer
from gaitd_session import ProfileError

from gaitd_display.engineer import EngineerServer
from gaitd_display.login import PasswordError, hash_password
from gaitd_display.patient import PatientServer
from gaitd_display.settings import (
    EngineerSettings,
    Link,
    PatientSettings,
    SettingsError,
    TherapistSettings,
    read_settings,
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
        _run(given.command, given)
    except (SettingsError, PasswordError, ProfileError, ClientError) as error:
        print(f"gaitd-display: {error}", file=sys.stderr)
        sys.exit(CONFIGURATION_ERROR)


def _run(command: str, given: argparse.Namespace) -> None:
    if command == "password":
        _print_hash()
    elif command == "patient":
        settings = read_settings(given.config, PatientSettings)
        trainer = trainer_of(settings.trainer, "gaitd-display patient")
        serve(PatientServer(settings, trainer, MonotonicClock()).app, settings.web)
    elif command == "engineer":
        settings = read_settings(given.config, EngineerSettings)
        trainer = trainer_of(settings.trainer, "gaitd-display engineer")
        serve(EngineerServer(settings, trainer, utc_ahead_ns).app, settings.web)
    else:
        settings = read_settings(given.config, TherapistSettings)
        trainer = trainer_of(settings.trainer, "gaitd-display therapist")
        serve(TherapistServer(settings, trainer, MonotonicClock()).app, settings.web)


def utc_ahead_ns() -> int:
    """Return UTC less monotonic time of this computer."""
    return time.time_ns() - time.monotonic_ns()


def _print_hash() -> None:
    password = getpass.getpass("password: ")
    if sys.stdin.isatty() and getpass.getpass("again: ") != password:
        raise PasswordError("the two are different; nothing was made")
    print(f'password_hash = "{hash_password(password)}"')


def trainer_of(link: Link, client: str) -> Trainer:
    """Return the trainer of a file; the connection is made when the server starts."""
    return Trainer(
        link.endpoint,
        link.read_credentials(),
        trainer=link.trainer,
        client=client,
        keep_trying=True,
    )


if __name__ == "__main__":
    main()
