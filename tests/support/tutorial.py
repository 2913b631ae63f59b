"""The programs of docs/tutorial.md as they are printed."""

import re
from pathlib import Path
from types import ModuleType
from typing import Final

PAGE: Final = Path(__file__).parents[2] / "docs" / "tutorial.md"
EXAMPLE: Final = re.compile(r"<!-- example: (\w+)\.py -->\n```python\n(.*?)```\n<!-- end -->", re.S)
LINES_MAX: Final = 50


def example(name: str) -> ModuleType:
    """A program of the page as a module, not as `__main__`; at most fifty lines of code."""
    text = dict(EXAMPLE.findall(PAGE.read_text(encoding="utf-8")))[name]
    assert len([line for line in text.splitlines() if line.strip()]) <= LINES_MAX
    module = ModuleType(name)
    exec(compile(text, f"{PAGE}: {name}", "exec"), module.__dict__)
    return module
