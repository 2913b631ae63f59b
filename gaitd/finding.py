"""What `gaitd doctor` finds: one fact, how it serves us, and what to do about it."""

from enum import Enum
from pathlib import Path
from typing import NamedTuple


class Grade(Enum):
    """How a fact serves us."""

    GOOD = "good"
    LIMITED = "limited"
    """Works with the limit that is said: fine for a desk, not with a person in the machine."""
    MISSING = "missing"
    """What needs it does not work here; the rest does."""
    BROKEN = "broken"
    """Nothing works until this is mended."""


class Finding(NamedTuple):
    """One fact, what it means, and what to do about it."""

    subject: str
    found: str
    grade: Grade
    remedy: str = ""


def read(path: Path) -> str:
    """The text of a small file of the kernel; empty where there is none to read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
