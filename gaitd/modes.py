"""`gaitd modes`: modes, requests and causes of stops, from the tables that the service uses."""

import sys
from pathlib import Path
from typing import Annotated

import typer

NAME = "modes.md"
ROLES_NAME = "security.md"


def command(
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            help="Folder of modes.md and security.md to renew; without it modes.md is printed.",
        ),
    ] = None,
) -> None:
    """Print the modes, the permitted requests, and each stop's remedy for the operator."""
    from daemon.config.limit_settings import Limits
    from daemon.config.shipped import configs_folder
    from daemon.config.strict import decoded, read_toml
    from gaitd_lab.mode_page import page
    from gaitd_lab.role_page import with_tables

    limits = decoded(read_toml(configs_folder("configs", "limits.toml") / "limits.toml"), Limits)
    text = page(limits.stop_category)
    if output is None:
        sys.stdout.write(text)
        return
    output.mkdir(parents=True, exist_ok=True)
    (output / NAME).write_text(text, encoding="utf-8")
    print(f"{output / NAME} is written")
    roles = output / ROLES_NAME
    if roles.exists():
        roles.write_text(with_tables(roles.read_text(encoding="utf-8")), encoding="utf-8")
        print(f"the tables of {roles} are written")
