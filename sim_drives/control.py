"""Commands to running virtual drives: text lines on a Unix datagram socket, and their sender.

A datagram is one or more lines. The answer is one datagram, `ok: ...` or `error: ...` for each
line, sent to the client's address if it has bound one. Sending never blocks.
"""

import contextlib
import socket
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Final

from sim_drives.faults.script import FaultCommandError

DATAGRAM_BYTES: Final = 4096
ANSWER_BYTES: Final = 65536
OBEYED_WITHIN_S: Final = 10.0
"""Longest wait for an answer, of the computer's time."""


class ControlSocket:
    """Polled command socket."""

    def __init__(self, listening: socket.socket, obey: Callable[[str], str]) -> None:
        self._socket = listening
        self._obey = obey

    def fileno(self) -> int:
        """Return the descriptor for poll()."""
        return self._socket.fileno()

    def serve(self) -> None:
        """Execute the received commands."""
        while True:
            try:
                data, sender = self._socket.recvfrom(DATAGRAM_BYTES)
            except BlockingIOError:
                return
            answer = "\n".join(self._answer(line) for line in _lines(data))
            if sender:
                # The client may have ended, or reads too slowly; the answer is then dropped.
                with contextlib.suppress(OSError):
                    self._socket.sendto(answer.encode(), sender)

    def _answer(self, line: str) -> str:
        try:
            return f"ok: {self._obey(line)}"
        except FaultCommandError as error:
            return f"error: {error}"


def _lines(data: bytes) -> list[str]:
    return data.decode("utf-8", errors="replace").splitlines() or [""]


@contextlib.contextmanager
def control_socket(path: Path, obey: Callable[[str], str]) -> Generator[ControlSocket]:
    """Listen at `path`; a socket left there by an earlier run is replaced.

    Raises:
        OSError: the path cannot be bound, or is something else than a socket.
    """
    if path.is_socket():
        path.unlink()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.setblocking(False)
        listening.bind(str(path))
        try:
            yield ControlSocket(listening, obey)
        finally:
            path.unlink(missing_ok=True)


def send_command(path: Path, line: str) -> str:
    """Send a line to the socket at `path`, and return the answer: `ok: ...` or `error: ...`.

    Raises:
        OSError: nothing listens there, or no answer comes.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.bind("")  # the kernel chooses an address for the answer
        sender.settimeout(OBEYED_WITHIN_S)
        sender.sendto(line.encode(), str(path))
        return sender.recv(ANSWER_BYTES).decode()
