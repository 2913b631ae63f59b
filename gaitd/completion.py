"""What a shell completes of the words of a trainer: its axes and its scenarios.

They are those of the trainer file of the command line or the environment.
"""

import os
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from gaitd.command_line import CONFIG_VARIABLE

if TYPE_CHECKING:
    from daemon.config.settings import Trainer

AXES: Final = ("right/hip", "right/slide")
"""Axes where no file is named."""


def axes(context: typer.Context) -> list[str]:
    """Return LEG/AXIS of each axis, and the axis alone where it is unique."""
    from daemon.config.trainer import drive_names

    trainer = _trainer(context)
    names = AXES if trainer is None else drive_names(trainer)
    ends = Counter(name.rpartition("/")[2] for name in names)
    return [*names, *(end for end, count in ends.items() if count == 1)]


def scenarios(context: typer.Context) -> list[str]:
    """Return the scenarios of mode excite."""
    trainer = _trainer(context)
    return [] if trainer is None else list(trainer.excite)


def _trainer(context: typer.Context) -> "Trainer | None":
    """Return the settings of the trainer file that the words so far name; None without a good one.

    A shell has no place for an error: the command itself reports it.
    """
    from gaitd_toml import ConfigError

    from daemon.config.trainer import load_trainer

    named = context.params.get("config") or os.environ.get(CONFIG_VARIABLE)
    try:
        return load_trainer(Path(named)).trainer if named else None
    except ConfigError:
        return None
