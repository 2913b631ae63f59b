"""Golden traces: `candump -L` lines with a trailing T (we send) or R (we receive), `#` comments."""

import re
from pathlib import Path
from typing import NamedTuple

from drives.bus import Frame

LINE = re.compile(r"\((\d+\.\d{6})\) \w+ ([0-9A-F]{3})#((?:[0-9A-F]{2})*) ([TR])")


class TraceLine(NamedTuple):
    time_ns: int
    frame: Frame
    sent: bool


def read_trace(path: Path) -> list[TraceLine]:
    """Every frame of a trace; anything that is neither a frame nor a comment is an error."""
    lines = []
    for text in path.read_text(encoding="utf-8").splitlines():
        if text.startswith("#") or not text.strip():
            continue
        match = LINE.fullmatch(text)
        if match is None:
            raise ValueError(f"{path.name}: {text}")
        stamp, can_id, data, direction = match.groups()
        time_ns = round(float(stamp) * 1e9)
        frame = Frame(int(can_id, 16), bytes.fromhex(data))
        lines.append(TraceLine(time_ns, frame, direction == "T"))
    return lines
