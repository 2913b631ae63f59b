"""The option --config of commands that play the demonstration's machine."""

from pathlib import Path
from typing import Annotated

import typer

from daemon.config.shipped import configs_folder

DemoFile = Annotated[
    Path | None,
    typer.Option("--config", help="trainer file; by default configs/demo.toml", dir_okay=False),
]


def words_of(config: Path | None) -> str:
    """Return what a command that is repeated has of this option."""
    return "" if config is None else f" --config {config}"


def demo_file(config: Path | None) -> Path:
    """Return the trainer file of the command line, by default the demonstration's."""
    return config or configs_folder("--config", "demo.toml") / "demo.toml"
