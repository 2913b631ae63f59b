"""The reference of the public Python packages, as Markdown with the directives of Sphinx's autodoc.

`docs/conf.py` puts it below the text of docs/python_api.md when the site is built.
"""

import ast
import importlib
import inspect
import re
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from types import ModuleType
from typing import Final, NamedTuple

import gaitd_names
import msgspec

from analysis import markdown

PACKAGES: Final = ("gaitd_client", "gaitd_names", "gaitd_texts", "gaitd_lab.testing")
"""In the order of the page; what several export is described at the first."""
MODULES: Final = {
    "gaitd_client": (
        *("aio", "connection", "credentials", "lease", "signals", "stream", "trainer", "wire"),
    )
}
"""Modules of a package whose constants are described with it."""
UNITS: Final = {"NS": "ns", "MS": "ms", "S": "s"}
"""By the end of a constant's name."""
VALUE_LENGTH_MAX: Final = 300
"""A longer value is shown by the number of its members."""


def reference() -> str:
    """Return the section of each package."""
    described: set[int] = set()
    return "\n\n".join(part for package in PACKAGES for part in parts(package, described))


def parts(package: str, described: set[int]) -> Iterator[str]:
    """Yield the heading of a package, and what it exports: classes, functions, exceptions, enums.

    Messages are in docs/messages.md. Enums are described with `gaitd_names`, that defines them.
    """
    module = importlib.import_module(package)
    exported = {name: getattr(module, name) for name in module.__all__}
    kinds: dict[str, list[str]] = {"autoclass": [], "autofunction": [], "enum": []}
    elsewhere: list[str] = []
    for name, value in exported.items():
        is_enum = inspect.isclass(value) and issubclass(value, Enum)
        defined_at = getattr(value, "__module__", "").partition(".")[0]
        if inspect.isclass(value) and issubclass(value, msgspec.Struct):
            elsewhere.append(name)
        elif id(value) in described or (is_enum and defined_at != package.partition(".")[0]):
            continue
        elif is_enum:
            kinds["enum"].append(name)
        elif inspect.isclass(value):
            kinds["autoclass"].append(name)
        elif inspect.isfunction(value):
            kinds["autofunction"].append(name)
        else:
            continue  # a constant: below; a type alias, a package: their sources say what they are
        described.add(id(value))
    yield f"## {package}"
    if rows := [*constants(package)]:
        yield f"### Constants of {package}"
        yield markdown.table(Constant._fields, rows)
    if elsewhere:
        names = ", ".join(f"`{one}`" for one in elsewhere)
        yield f"Structs of messages ([fields](messages.md)): {names}."
    for kind, names in kinds.items():
        for name in names:
            members = "" if kind == "autofunction" else "\n   :members:"
            undescribed = "\n   :undoc-members:" if kind == "enum" else ""
            directive = "autoclass" if kind == "enum" else kind
            yield f"### {name}"
            yield f"```{{eval-rst}}\n.. {directive}:: {package}.{name}{members}{undescribed}\n```"


class Constant(NamedTuple):
    """A row of the table of constants."""

    name: str
    value: str
    unit: str
    meaning: str


def constants(package: str) -> Iterator[Constant]:
    """Yield a row for each constant that a package exports, or that one of its MODULES has.

    The meaning is the string below the constant, as of an attribute of a class.
    """
    for module in map(importlib.import_module, (package, *_modules(package))):
        texts = _texts(module)
        own = getattr(module, "__all__", texts)
        texts = {**_texts(gaitd_names), **texts}  # which others export again
        for name in (one for one in own if re.fullmatch(r"[A-Z][A-Z0-9_]+", one)):
            place = module.__name__.removeprefix(package).lstrip(".")
            value = getattr(module, name)
            full_name = f"`{place}.{name}`" if place else f"`{name}`"
            yield Constant(full_name, _value(value), _unit(name), texts.get(name, ""))


def _modules(package: str) -> Iterator[str]:
    return (f"{package}.{name}" for name in MODULES.get(package, ()))


def _texts(module: ModuleType) -> Mapping[str, str]:
    """Constants of a module with the string below each; of a package those of all its modules."""
    file = Path(inspect.getfile(module))
    files = sorted(file.parent.rglob("*.py")) if file.name == "__init__.py" else [file]
    found: dict[str, str] = {}
    for body in (ast.parse(one.read_bytes()).body for one in files):
        for one, following in zip(body, [*body[1:], ast.Pass()], strict=True):
            if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name):
                text = ast.get_docstring(ast.Module([following], [])) or ""
                found[one.target.id] = " ".join(text.split())
    return found


def _value(value: object) -> str:
    if isinstance(value, re.Pattern):
        return _code(value.pattern)
    if isinstance(value, frozenset):
        value = tuple(sorted(value))
    if isinstance(value, tuple) and all(isinstance(one, Enum) for one in value):
        return ", ".join(_code(one.name) for one in value)
    if isinstance(value, tuple | dict) and len(repr(value)) > VALUE_LENGTH_MAX:
        return f"{len(value)} members"
    return _code(repr(value))


def _code(text: str) -> str:
    return f"`` {text} ``" if "`" in text else f"`{text}`"


def _unit(name: str) -> str:
    """Unit of a constant by the end of its name; a dash for one that has none."""
    ends = [UNITS.get(part.rpartition("_")[2], "") for part in name.split("_PER_")]
    return "/".join(ends) if all(ends) else "–"
