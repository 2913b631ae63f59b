"""An SDO server that answers as a test says, and a client for it, on a bus in memory."""

import struct

from memory_bus import MS, ManualClock, MemoryBus

from drives.bringup.configurator import Configurator
from drives.canopen.bus import Frame

NODE = 5


class Server:
    """A node whose replies are a function of the request; each reply comes 1 ms later."""

    next_beat_ns = None

    def __init__(self, reply):
        self.reply = reply
        self.requests = []

    def take(self, frame, now_ns):
        if frame.can_id != 0x600 + NODE:
            return []
        self.requests.append(frame.data)
        replies = self.reply(frame.data)
        return [(Frame(0x580 + NODE, data), (n + 1) * MS) for n, data in enumerate(replies)]

    def beats(self, now_ns):
        return []

    @property
    def aborts(self):
        return [data for data in self.requests if data[0] == 0x80]


def client(reply, **options):
    clock = ManualClock()
    server = Server(reply)
    return Configurator(MemoryBus(clock, [server]), clock, **options), server, clock


def segmented(data, announced=None, toggles=(0, 1), end=True):
    """Replies of a server that sends everything in segments of seven bytes."""
    count = len(data) if announced is None else announced
    state = {"place": 0, "n": 0}

    def reply(request):
        if request[0] == 0x40:
            state.update(place=0, n=0)
            return [b"\x41" + request[1:4] + struct.pack("<I", count)]
        if request[0] & 0xE0 == 0x60:
            part = data[state["place"] : state["place"] + 7]
            state["place"] += len(part)
            last = end and state["place"] >= len(data)
            toggle = toggles[state["n"] % 2]
            state["n"] += 1
            command = toggle << 4 | (7 - len(part)) << 1 | last
            return [bytes((command,)) + part.ljust(7, b"\0")]
        return []

    return reply
