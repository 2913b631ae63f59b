"""The command `gaitd-display`: the two servers, and the hash of a password."""

import argparse
import sys
from pathlib import Path
from typing import Final

from gaitd_client import ClientError, Trainer

from gaitd_display.patient import PatientServer
from gaitd_display.settings import Link, PatientSettings, SettingsError, read_settings
from gaitd_display.web import serve

CONFIGURATION_ERROR: Final = 2


def main() -> None:
    """Run the command; exit code 2 for a file that cannot be used."""
    parser = argparse.ArgumentParser(prog="gaitd-display", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, text in (("patient", "serve the patient's page"),):
        command = commands.add_parser(name, help=text)
        command.add_argument("--config", type=Path, required=True, metavar="FILE")
    given = parser.parse_args()
    try:
        _run(given.command, given)
    except (SettingsError, ClientError) as error:
        print(f"gaitd-display: {error}", file=sys.stderr)
        sys.exit(CONFIGURATION_ERROR)


def _run(command: str, given: argparse.Namespace) -> None:
    settings = read_settings(given.config, PatientSettings)
    server = PatientServer(settings, trainer_of(settings.trainer, f"gaitd-display {command}"))
    serve(server.app, settings.web)


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
