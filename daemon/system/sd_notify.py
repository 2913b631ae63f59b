"""Notifications to systemd (sd_notify(3)): READY=1, WATCHDOG=1, STATUS=, STOPPING=1.

Twenty lines instead of a library: the protocol is one datagram, and the send must never block or
raise in the 10 ms loop. Without systemd nothing is sent.
"""

import socket


class Notifier:
    """Datagram socket to systemd's address in NOTIFY_SOCKET."""

    def __init__(self, address: str | None) -> None:
        """`address` is the value of NOTIFY_SOCKET: a path, `@name` for the abstract namespace."""
        self._address = "\0" + address[1:] if address and address[0] == "@" else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)

    def send(self, *lines: str) -> bool:
        """Send `KEY=value` lines; False if systemd could not take them."""
        if self._address:
            try:
                message = "\n".join(line.replace("\n", " ") for line in lines)
                self._socket.sendto(message.encode(errors="replace"), self._address)
            except OSError:
                return False
        return True

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
