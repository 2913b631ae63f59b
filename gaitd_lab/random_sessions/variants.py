"""The configurations of the sessions: make of drives, guidance, patient or empty machine.

A variant is a copy of the trainer file's folder with a few words replaced, as an operator would
edit them.
"""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Final

TRAINER: Final = "demo.toml"
PLANT: Final = "plant.toml"

Edit = tuple[str, str, str]
"""File, old text, new text."""


def _make(drives: str, personality: str, eds: str) -> tuple[Edit, ...]:
    return (
        (TRAINER, "hip_epos4", f"hip_{drives}"),
        (TRAINER, "slide_epos4", f"slide_{drives}"),
        (PLANT, 'personality = "epos4"', f'personality = "{personality}"'),
        (PLANT, "epos4.eds", eds),
    )


_GENERIC: Final = _make("generic", "generic", "generic402.eds")
_ELMO: Final = _make("elmo", "elmo_gold", "elmo_gold.eds")
_POSITION: Final[Edit] = (TRAINER, 'guidance = "impedance"', 'guidance = "position"')
_EMPTY: Final[tuple[Edit, ...]] = (
    (TRAINER, '"robot.toml"', '"robot_empty.toml"'),
    (PLANT, '"robot.toml"', '"robot_empty.toml"'),
)

VARIANTS: Final[Mapping[str, tuple[Edit, ...]]] = {
    "EPOS4, impedance": (),
    "CiA 402, position": (*_GENERIC, _POSITION),
    "EPOS4, position": (_POSITION,),
    "CiA 402, impedance": _GENERIC,
    "Elmo, impedance": _ELMO,
    "EPOS4, impedance, empty machine": _EMPTY,
}


def written(edits: tuple[Edit, ...], source: Path, folder: Path) -> Path:
    """Copy the configuration and edit it; return the path of its trainer file.

    Args:
        edits: the replacements.
        source: the folder of the shipped configuration.
        folder: must not exist yet.

    Raises:
        ValueError: a file lacks the text to be replaced (a bug of the edits).
    """
    shutil.copytree(source, folder)
    for file, old, new in edits:
        text = (folder / file).read_text(encoding="utf-8")
        if old not in text:
            raise ValueError(f"{file} does not say {old!r}")
        (folder / file).write_text(text.replace(old, new), encoding="utf-8")
    return folder / TRAINER
