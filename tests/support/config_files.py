"""A copy of configs/ that a test may break."""

import json
import shutil
from pathlib import Path
from typing import Any, NamedTuple

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


class Change(NamedTuple):
    """One text in one file replaced by another."""

    file: str
    old: str
    new: str


def copied(folder: Path) -> Path:
    """All of configs/ below `folder`; returns the folder of the copy."""
    return Path(shutil.copytree(CONFIGS, folder / "configs"))


def changed(configs: Path, *changes: Change) -> Path:
    """The copy with its changes made; returns its demo.toml."""
    for change in changes:
        path = configs / change.file
        text = path.read_text(encoding="utf-8")
        assert text.count(change.old) >= 1, f"{change.file} does not say {change.old!r}"
        path.write_text(text.replace(change.old, change.new, 1), encoding="utf-8")
    return configs / "demo.toml"


def toml(table: dict[str, Any]) -> str:
    """The table as TOML, one inline value for each key."""
    return "".join(f"{json.dumps(key)} = {_inline(value)}\n" for key, value in table.items())


def _inline(value: Any) -> str:
    match value:
        case dict():
            pairs = (f"{json.dumps(key)} = {_inline(one)}" for key, one in value.items())
            return "{" + ", ".join(pairs) + "}"
        case list() | tuple():
            return "[" + ", ".join(map(_inline, value)) + "]"
        case bool() | str():
            return json.dumps(value, ensure_ascii=False)
        case int() | float():
            return repr(value)
        case _:
            return value.isoformat()
