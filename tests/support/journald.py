"""A datagram socket in journald's place, and a reader of its protocol that shares no code with us.

https://systemd.io/JOURNAL_NATIVE_PROTOCOL/: `NAME=value\n`, or `NAME\n`, 64 bits little-endian of
length, the value, `\n`.
"""

import contextlib
import socket
import struct


def parsed(datagram):
    fields = {}
    while datagram:
        head, _, rest = datagram.partition(b"\n")
        name, equals, value = head.partition(b"=")
        if not equals:
            (length,) = struct.unpack_from("<Q", rest)
            value, rest = rest[8 : 8 + length], rest[8 + length :]
            assert rest[:1] == b"\n"
            rest = rest[1:]
        fields[name.decode()] = value.decode()
        datagram = rest
    return fields


class Journald:
    """Keeps every entry that comes."""

    def __init__(self, path):
        self.path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.setblocking(False)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()
        self.path.unlink()

    def entries(self):
        """What has come since the last time this was asked."""
        found = []
        with contextlib.suppress(BlockingIOError):
            while True:
                found.append(parsed(self._socket.recv(1 << 20)))
        return found
