"""What `gaitd doctor` reports: a fact about the machine, its grade, and a remedy."""

from enum import Enum
from pathlib import Path
from typing import NamedTuple


class Grade(Enum):
    """How well a fact meets the needs of gaitd."""

    GOOD = "good"
    LIMITED = "limited"
    """Works with the stated limit: fine for a desk, not with a person in the machine."""
    MISSING = "missing"
    """Features that need it do not work here; all others do."""
    BROKEN = "broken"
    """Nothing works until this is repaired."""


class Finding(NamedTuple):
    """A fact about the machine, its grade, and a remedy."""

    subject: str
    found: str
    grade: Grade
    remedy: str = ""


def read(path: Path) -> str:
    """Read a small file of the kernel; empty if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
