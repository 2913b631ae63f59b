"""Frames of a recorded CAN bus, from the files of candump, Vector, PEAK and python-can.

Rules:
1.  What is left out is counted by its reason, in `FrameFile.notes`: error frames of the controller,
    frames that are no CANopen, a last line or an end of a BLF that was torn off.
2.  A line that cannot be read is an error with its number, unless it is the torn last one.
3.  Frames whose times go back by up to a millisecond were swapped on their way into the file: they
    are sorted by time, and counted. Times that go back further are an error.
"""

import io
import logging
import re
import struct
import zlib
from bisect import insort
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

import can

from drives.canopen.data_sheet import text_of
from drives.service.bus_recording import BusFrame, RecordedBusError

SWAP_MAX_S: Final = 1e-3
"""Frames of one bus that reach a file in another order: the queues of a driver."""
TRC_VERSIONS: Final = ("1.0", "1.1", "1.3", "2.0", "2.1")
NO_CANOPEN: Final = "extended, remote or CAN FD frames: not CANopen"
ERROR_FRAMES: Final = "error frames of the bus"
SWAPPED: Final = f"frames stood out of order by less than {SWAP_MAX_S * 1e3:g} ms: sorted by time"
TORN: Final = "last line without its end: left out"
OTHER_LINES: Final = "lines with a time that are no frames, as statistics of the bus"
_ERROR_FLAG: Final = 1 << 29
_CANDUMP: Final = re.compile(r"\((\d+\.\d+)\)\s+(\S+)\s+([0-9A-Fa-f]{3,8})#(#?)(\w*)(?:\s+[RT])?")
_ASC_TIMED: Final = re.compile(r"(-?\d+\.\d+)\s+(.*)")
_ASC_FRAME: Final = re.compile(
    r"(\d+)\s+([0-9A-Fa-f]+)(x?)\s+(?:Rx|Tx)\s+([dr])\s*([0-9A-Fa-f]*)(.*)", re.IGNORECASE
)
_ASC_ERROR: Final = re.compile(r"(?:CANFD\s+)?\d+\s+(?:(?:Rx|Tx)\s+)?ErrorFrame", re.IGNORECASE)
_ASC_BASE: Final = re.compile(r"base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.I)
_BLF_SIZE: Final = struct.Struct("<4sL8xQ")
"""Signature, size of the header, and at 16 the size of the file."""
_BLF_OBJECT: Final = struct.Struct("<4s4xLL")
"""Signature, size and kind of an object."""
_BLF_FRAMES: Final = frozenset((1, 73, 86, 100, 101))
"""Kinds of objects that are frames of CAN, or errors of it."""
NO_CONTAINER: Final = "frames of the BLF outside a container: left out"


class FrameFileError(RecordedBusError):
    """A file cannot be read as frames; names it."""


class _Frame(NamedTuple):
    time_s: float
    channel: str
    can_id: int
    data: bytes
    reason: str = ""
    """Why it is left out; empty for a frame of CANopen."""


class _BadLineError(Exception):
    """A line that is none of its format."""


_Note = Callable[[str], None]


class FrameFile:
    """The classic frames with 11-bit identifiers of a file; each pass reads it again."""

    def __init__(self, path: Path) -> None:
        """Raise FrameFileError for a name of no known format."""
        if path.suffix.lower() not in FORMATS:
            raise FrameFileError(f"{path}: its name must end in {', '.join(FORMATS)}")
        self._path = path
        self._counts: Counter[str] = Counter()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out or changed in the last pass, with its count."""
        return tuple(f"{count} {reason}" for reason, count in self._counts.items())

    def __iter__(self) -> Iterator[BusFrame]:
        """Raise FrameFileError where the file cannot be read, with the number of the line."""
        self._counts.clear()
        waiting: list[BusFrame] = []
        newest_s = float("-inf")
        for frame in self._of_one_bus():
            if frame.time_s < newest_s:
                if frame.time_s < newest_s - SWAP_MAX_S:
                    raise self._error(f"time goes back to {frame.time_s:.6f} s")
                self._counts[SWAPPED] += 1
            one = BusFrame(frame.time_s, frame.can_id, frame.data)
            if frame.time_s >= newest_s:
                newest_s = frame.time_s
                waiting.append(one)
            else:
                insort(waiting, one, key=_time)
            while waiting[0].time_s <= newest_s - SWAP_MAX_S:
                yield waiting.pop(0)
        yield from waiting

    def _of_one_bus(self) -> Iterator[_Frame]:
        channel: str | None = None
        for frame in self._frames():
            if frame.reason:
                self._counts[frame.reason] += 1
                continue
            if channel not in (None, frame.channel):
                wrong = f"it is of {frame.channel}, the one before of {channel}"
                raise self._error(f"{wrong}: keep those of one bus")
            channel = frame.channel
            yield frame

    def _frames(self) -> Iterator[_Frame]:
        self._read_count = 0
        try:
            for frame in FORMATS[self._path.suffix.lower()](self._path, self._note):
                self._read_count += 1
                yield frame
        except OSError as error:
            raise FrameFileError(f"{self._path}: {error.strerror or error}") from error
        except _BadLineError as error:
            raise FrameFileError(f"{self._path}: {error}") from error

    def _note(self, reason: str) -> None:
        self._counts[reason] += 1

    def _error(self, what: str) -> FrameFileError:
        return FrameFileError(f"{self._path}: frame {self._read_count}: {what}")


def _time(frame: BusFrame) -> float:
    return frame.time_s


# --- formats --------------------------------------------------------------------------------------


def _whole_lines(path: Path, note: _Note) -> Iterator[str]:
    """Lines of a text; a last one without its end was torn off."""
    with path.open("rb") as file:
        for line in file:
            if line.endswith(b"\n"):
                yield text_of(line).strip()
            elif line.strip():
                note(TORN)


def _candump(path: Path, note: _Note) -> Iterator[_Frame]:
    for number, line in enumerate(_whole_lines(path, note), 1):
        if not line:
            continue
        frame = _candump_frame(line)
        if frame is None:
            raise _BadLineError(
                f"line {number}: {line[:60]!r}; allowed is what `candump -L can0` writes, as "
                "(1700000000.000400) can0 185#3712"
            )
        yield frame


def _candump_frame(line: str) -> _Frame | None:
    match = _CANDUMP.fullmatch(line)
    if match is None:
        return None
    time_text, channel, id_text, is_fd, payload = match.groups()
    can_id = int(id_text, 16)
    reason = ERROR_FRAMES if len(id_text) == 8 and can_id & _ERROR_FLAG else ""
    if not reason and (len(id_text) != 3 or is_fd or payload[:1].upper() == "R"):
        reason = NO_CANOPEN
    try:
        data = b"" if reason else bytes.fromhex(payload)
    except ValueError:
        return None
    return _Frame(float(time_text), channel, can_id, data, reason)


def _asc(path: Path, note: _Note) -> Iterator[_Frame]:
    """Vector's text: a header of any program, then events with a time from the start."""
    base, is_relative, now_s = 16, False, 0.0
    for number, line in enumerate(_whole_lines(path, note), 1):
        if (header := _ASC_BASE.match(line)) is not None:
            base = 16 if header[1].lower() == "hex" else 10
            is_relative = (header[2] or "").lower() == "relative"
        elif (event := _ASC_TIMED.match(line)) is not None:
            now_s = float(event[1]) + (now_s if is_relative else 0.0)
            try:
                frame = _asc_event(event[2], base, now_s)
            except ValueError:
                text = f"line {number}: {line[:60]!r}; allowed are bytes of base {base}"
                raise _BadLineError(text) from None
            if frame is not None:
                yield frame
            elif "start of measurement" not in line.lower():
                note(OTHER_LINES)


def _asc_event(text: str, base: int, time_s: float) -> _Frame | None:
    """The frame of an event; None for another event."""
    if _ASC_ERROR.match(text):
        return _Frame(time_s, "", 0, b"", ERROR_FRAMES)
    match = _ASC_FRAME.match(text)
    if match is None:
        return _Frame(time_s, "", 0, b"", NO_CANOPEN) if text[:5].upper() == "CANFD" else None
    channel, id_text, is_extended, kind, length, rest = match.groups()
    if is_extended or kind.lower() == "r":
        return _Frame(time_s, channel, 0, b"", NO_CANOPEN)
    count = min(int(length, base), 8)
    parts = rest.split()[:count]
    if len(parts) < count:
        raise ValueError(text)
    return _Frame(time_s, channel, int(id_text, base), bytes(int(part, base) for part in parts))


def _trc(path: Path, note: _Note) -> Iterator[_Frame]:
    lines = list(_whole_lines(path, note))
    head = "\n".join(line for line in lines if line.startswith(";"))
    version = re.search(r"^;\$FILEVERSION=(\S+)", head, re.MULTILINE)
    if version is not None and version[1] not in TRC_VERSIONS:
        raise _BadLineError(f"it is TRC {version[1]}; allowed are {', '.join(TRC_VERSIONS)}")
    count = 0
    for frame in _of_library(path, can.TRCReader(_text(lines))):
        count += 1
        yield frame
    events = sum(1 for line in lines if line and not line.startswith(";"))
    for _ in range(events - count):
        note(OTHER_LINES)


def _csv(path: Path, note: _Note) -> Iterator[_Frame]:
    yield from _of_library(path, can.CSVReader(_text(_whole_lines(path, note))))


def _text(lines: Iterable[str]) -> io.StringIO:
    return io.StringIO("".join(f"{line}\n" for line in lines))


def _blf(path: Path, note: _Note) -> Iterator[_Frame]:
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_BLF_SIZE.size)
    if len(head) == _BLF_SIZE.size:
        _, _, told = _BLF_SIZE.unpack(head)
        if told > size:
            note(f"end torn off: {size} of {told} bytes are there, and the frames behind are lost")
    try:
        reader = can.BLFReader(path)
    except _BROKEN as error:
        raise _BadLineError(f"frame 1: {_said(error)}; allowed is a whole .blf file") from error
    for _ in range(_count_outside_containers(path)):
        note(NO_CONTAINER)
    with reader, _told(note):
        count = 0
        try:
            for one in reader:
                count += 1
                yield _of_message(one)
        except _BROKEN as error:
            if not count:
                raise _BadLineError(
                    f"frame 1: {_said(error)}; allowed is a whole .blf file"
                ) from error
            note(f"end of the BLF that cannot be read ({_said(error)}): frames behind it are lost")
        else:
            if vars(reader)["_tail"].strip(b"\0"):
                note("end torn off within an object: frames behind it are lost")


def _count_outside_containers(path: Path) -> int:
    """Count the objects that python-can passes over: it reads those in containers alone."""
    count = 0
    with path.open("rb") as file:
        _, header_size, _ = _BLF_SIZE.unpack(file.read(_BLF_SIZE.size))
        file.seek(header_size)
        while len(head := file.read(_BLF_OBJECT.size)) == _BLF_OBJECT.size:
            signature, size, kind = _BLF_OBJECT.unpack(head)
            if signature != b"LOBJ" or size < _BLF_OBJECT.size:
                break
            count += kind in _BLF_FRAMES
            file.seek(size - _BLF_OBJECT.size + size % 4, io.SEEK_CUR)
    return count


class _Told(logging.Handler):
    """Turns what python-can logs about a part that it leaves out into a note."""

    def __init__(self, note: _Note) -> None:
        super().__init__(logging.WARNING)
        self._note = note

    def emit(self, record: logging.LogRecord) -> None:
        self._note(f"parts of the BLF left out, with their frames: {record.getMessage()}")


@contextmanager
def _told(note: _Note) -> Generator[None]:
    handler, log = _Told(note), logging.getLogger("can.io.blf")
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)


def _of_library(path: Path, reader: Iterable[can.Message]) -> Iterator[_Frame]:
    """Frames of a reader of python-can; what it meets in a file of another content is an error."""
    count = 0
    try:
        for one in reader:
            count += 1
            yield _of_message(one)
    except _BROKEN as error:
        raise _BadLineError(
            f"frame {count + 1}: {_said(error)}; allowed is a whole {path.suffix} file"
        ) from error


_BROKEN: Final = (
    ValueError,
    LookupError,
    TypeError,
    NotImplementedError,
    EOFError,
    struct.error,
    zlib.error,
    can.CanError,
    can.io.blf.BLFParseError,
)


def _said(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _of_message(one: can.Message) -> _Frame:
    reason = ""
    if one.is_error_frame:
        reason = ERROR_FRAMES
    elif one.is_extended_id or one.is_remote_frame or one.is_fd:
        reason = NO_CANOPEN
    data = bytes(one.data or b"")
    return _Frame(one.timestamp, str(one.channel), one.arbitration_id, data, reason)


FORMATS: Final = {
    ".asc": _asc,
    ".blf": _blf,
    ".csv": _csv,
    ".log": _candump,
    ".trc": _trc,
}
"""Reader of each format, by the end of the file's name."""
