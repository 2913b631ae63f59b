"""A station that talks nonsense on the bus of a lock-step session, from a seed.

Everybody on the bus hears it: the service and the drives. Most of what it says looks nearly right:
identifiers of the two drives, plausible lengths, small numbers. Error frames of the controller are
heard by the service alone. What it never sends is a correctly long RPDO: that would not be noise
but a second master, which no CANopen device can tell from the first.
"""

import random
from collections.abc import Callable
from typing import Final, NamedTuple

from drives.canopen.bus import Frame
from gaitd_lab.lockstep import WorldBus
from sim_drives.world import World

NODES: Final = (5, 6)
RPDO_BYTES: Final = {0x205: 7, 0x206: 7, 0x305: 2, 0x306: 2}
ERROR_CLASSES: Final = (0x001, 0x002, 0x004, 0x008, 0x010, 0x020, 0x040, 0x080, 0x100, 0x200)


def some_bytes(rng: random.Random, length: int) -> bytes:
    return bytes(rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256))) for _ in range(length))


def anything(rng: random.Random) -> Frame:
    return Frame(rng.randrange(0x800), some_bytes(rng, rng.randrange(9)))


def network(rng: random.Random) -> Frame:
    command = rng.choice((0x01, 0x02, 0x80, 0x81, 0x82, rng.randrange(256)))
    node = rng.choice((*NODES, *NODES, 0, rng.randrange(128)))
    return Frame(0x000, bytes((command, node))[: rng.choice((0, 1, 2, 2, 2))])


def sync(rng: random.Random) -> Frame:
    return Frame(0x080, some_bytes(rng, rng.choice((0, 0, 0, 1, 2))))


def emergency(rng: random.Random) -> Frame:
    return Frame(0x080 + rng.choice(NODES), some_bytes(rng, rng.choice((8, 8, rng.randrange(9)))))


def process_data(rng: random.Random) -> Frame:
    service = rng.choice((0x180, 0x280, 0x380, 0x480))
    length = rng.choice((7, 6, 8, 4, rng.randrange(9)))
    return Frame(service + rng.choice(NODES), some_bytes(rng, length))


def wrong_command(rng: random.Random) -> Frame:
    can_id = rng.choice(tuple(RPDO_BYTES))
    lengths = [length for length in range(9) if length < RPDO_BYTES[can_id]]
    return Frame(can_id, some_bytes(rng, rng.choice(lengths)))


def heartbeat(rng: random.Random) -> Frame:
    state = rng.choice((0x00, 0x04, 0x05, 0x7F, rng.randrange(256)))
    return Frame(0x700 + rng.choice((*NODES, 1)), bytes((state,)) * rng.choice((1, 1, 1, 0, 2)))


def sdo_reply(rng: random.Random) -> Frame:
    head = bytes(
        (rng.choice((0x60, 0x43, 0x4B, 0x4F, 0x41, 0x80, 0x20, 0x00, rng.randrange(256))),)
    )
    place = rng.choice((b"\x40\x60\x00", b"\x00\x10\x00", b"\x18\x10\x01", some_bytes(rng, 3)))
    return Frame(
        0x580 + rng.choice(NODES), (head + place + some_bytes(rng, 4))[: rng.choice((8, 8, 5))]
    )


def sdo_request(rng: random.Random) -> Frame:
    return Frame(0x600 + rng.choice(NODES), some_bytes(rng, rng.choice((8, 8, rng.randrange(9)))))


def controller_error(rng: random.Random) -> Frame:
    return Frame(rng.choice(ERROR_CLASSES), some_bytes(rng, 8), is_error=True)


def is_command(frame: Frame) -> bool:
    """A correctly long RPDO: what no babbler says."""
    mapped = RPDO_BYTES.get(frame.can_id)
    return not frame.is_error and mapped is not None and len(frame.data) >= mapped


RESTARTED: Final = 0x100
Kind = Callable[[random.Random], Frame]
KINDS: Final[tuple[Kind, ...]] = (
    anything,
    network,
    sync,
    emergency,
    process_data,
    wrong_command,
    heartbeat,
    sdo_reply,
    sdo_request,
    controller_error,
)


class Said(NamedTuple):
    """One frame of the babbler's."""

    time_ns: int
    frame: Frame


class Babbler:
    """Speaks while `rate_hz` is above zero."""

    def __init__(self, world: World, bus: WorldBus, seed: int) -> None:
        self.said: list[Said] = []
        self._world, self._bus = world, bus
        self._rng = random.Random(seed)
        self._kinds: tuple[Kind, ...] = KINDS
        self._rate_hz = 0.0
        self._next_ns: int | None = None
        self._advance_to, self._next_event_ns = world.advance_to, world.next_event_ns
        world.advance_to, world.next_event_ns = self._talk_until, self._next_of_both

    def start(self, rate_hz: float, *kinds: Kind) -> None:
        self._rate_hz, self._kinds = rate_hz, kinds or KINDS
        self._plan()

    def stop(self) -> None:
        """Silence; a controller that went bus-off comes back, as `restart-ms` would have it."""
        if self._next_ns is not None:
            back = Frame(RESTARTED, bytes(8), self._world.now_ns, is_error=True)
            self._bus.seat.waiting.append(back)
        self._next_ns = None

    def _plan(self) -> None:
        self._next_ns = self._world.now_ns + int(self._rng.expovariate(self._rate_hz) * 1e9)

    def _next_of_both(self) -> int:
        event_ns = self._next_event_ns()
        return event_ns if self._next_ns is None else min(event_ns, self._next_ns)

    def _talk_until(self, time_ns: int) -> list[Frame]:
        traffic: list[Frame] = []
        while self._next_ns is not None and self._next_ns <= time_ns:
            traffic += self._advance_to(self._next_ns)
            traffic += self._say(self._rng.choice(self._kinds)(self._rng))
            self._plan()
        return traffic + self._advance_to(time_ns)

    def _say(self, frame: Frame) -> list[Frame]:
        now_ns = self._world.now_ns
        if is_command(frame):
            return []
        self.said.append(Said(now_ns, frame))
        if frame.is_error:
            self._bus.seat.waiting.append(frame._replace(time_ns=now_ns))
            return []
        self._world.receive(Frame(frame.can_id, frame.data))
        return [Frame(frame.can_id, frame.data, now_ns)]
