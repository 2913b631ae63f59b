"""Numbers of a TOML file: those that no range refuses, because no comparison with them is true."""

import math
from collections.abc import Iterator
from typing import cast


def not_finite(value: object, key: str = "") -> Iterator[tuple[str, float]]:
    """Each NaN and infinity in a table, with its dotted key, in the order of the file."""
    match value:
        case float():
            if not math.isfinite(value):
                yield key, value
        case dict():
            for name, inner in cast("dict[str, object]", value).items():
                yield from not_finite(inner, f"{key}.{name}" if key else name)
        case list():
            for index, inner in enumerate(cast("list[object]", value)):
                yield from not_finite(inner, f"{key}[{index}]")
        case _:
            pass
