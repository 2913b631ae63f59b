"""Traces as `candump -L` lines with a trailing T (we send) or R (we receive), `#` comments."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from drives.canopen.bus import Frame

LINE = re.compile(r"\((\d+\.\d{6})\) \w+ ([0-9A-F]{3})#((?:[0-9A-F]{2})*) ([TR])")


class TraceLine(NamedTuple):
    time_ns: int
    frame: Frame
    sent: bool

    def __str__(self) -> str:
        return f"{candump_line(self.time_ns, self.frame)} {'T' if self.sent else 'R'}"


def candump_line(time_ns: int, frame: Frame) -> str:
    """As `candump -L` writes it and `canplayer` reads it."""
    return f"({time_ns / 1e9:.6f}) can0 {frame.can_id:03X}#{frame.data.hex().upper()}"


def read_trace(path: Path) -> list[TraceLine]:
    """Every frame of a trace; anything that is neither a frame nor a comment is an error."""
    return parse_trace(path.read_text(encoding="utf-8").splitlines(), path.name)


def parse_trace(lines: Iterable[str], name: str) -> list[TraceLine]:
    """As `read_trace`, from its lines."""
    trace = []
    for text in lines:
        if text.startswith("#") or not text.strip():
            continue
        match = LINE.fullmatch(text)
        if match is None:
            raise ValueError(f"{name}: {text}")
        stamp, can_id, data, direction = match.groups()
        time_ns = round(float(stamp) * 1e9)
        frame = Frame(int(can_id, 16), bytes.fromhex(data))
        trace.append(TraceLine(time_ns, frame, direction == "T"))
    return trace
