"""The reference of the public Python packages, as Markdown with the directives of Sphinx's autodoc.

`docs/conf.py` puts it below the text of docs/python_api.md when the site is built.
"""

import importlib
import inspect
from collections.abc import Iterator
from enum import Enum
from typing import Final

import msgspec

PACKAGES: Final = ("gaitd_client", "gaitd_names", "gaitd_texts", "gaitd_lab.testing")
"""In the order of the page; what several export is described at the first."""


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
            continue  # a constant, a type alias, a package: their sources say what they are
        described.add(id(value))
    yield f"## {package}"
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
