"""Survey of a bus: listen, read 1000h of all 127 nodes, then the identity of those that answer.

`survey` is a generator like `bringup.bring_up`: it yields its progress and returns what it found.
It only reads and listens: no NMT command, no write, no SYNC. Rules:

1.  SDO channels of different nodes are independent (CiA 301 7.2.4): requests go to all nodes one
    after the other, and the answers are collected, so a silent node adds no waiting time.
2.  It must not disturb a bus in use: between two requests lie PAUSE_FRAMES frame times, so the
    requests take an eighth of the bus at most, their identifiers lose every arbitration against
    SYNC and PDOs, and the transmit queue shared with a service holds one frame of the survey.
3.  A node to which another client sends SDO requests (a bring-up) gets no request with an answer of
    several frames: its names, in segments, would mix with the other's transfer.
4.  A node that stops answering gets no more requests, so only one timeout is spent on it.
5.  If the first frames are not acknowledged, or end in bus-off, no more are sent.
"""

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from drives.bringup.configurator import Configurator
from drives.canopen.bus import Bus, Clock
from drives.canopen.objects import Object
from drives.canopen.sdo import upload_request
from drives.canopen.sniffer import BusSniffer, SniffedBus
from drives.errors import SdoAborted, SdoGarbled, SdoTimeout

LISTEN_NS: Final = 1_000_000_000
"""Before the first request: heartbeats, SYNC and commands of a running service."""
ANSWER_NS: Final = 200_000_000
"""Wait after the last request; a drive answers within some ms."""
SLICE_NS: Final = 50_000_000
"""Longest wait between two yields."""
SEND_TIMEOUT_NS: Final = 20_000_000
PAUSE_FRAMES: Final = 8
FRAME_BITS: Final = 130
"""Bits of a frame of eight bytes, with stuffing."""
NODES: Final = range(1, 128)

DEVICE_TYPE: Final = (Object.DEVICE_TYPE, 0)
ERROR_REGISTER: Final = (Object.ERROR_REGISTER, 0)
VENDOR: Final = (Object.IDENTITY, 1)
PRODUCT: Final = (Object.IDENTITY, 2)
REVISION: Final = (Object.IDENTITY, 3)
SERIAL: Final = (Object.IDENTITY, 4)
ERROR_CODE: Final = (Object.ERROR_CODE, 0)
STATUSWORD: Final = (Object.STATUSWORD, 0)
DEVICE_NAME: Final = (Object.DEVICE_NAME, 0)
HARDWARE_VERSION: Final = (Object.HARDWARE_VERSION, 0)
SOFTWARE_VERSION: Final = (Object.SOFTWARE_VERSION, 0)

NUMBERS: Final = (DEVICE_TYPE, ERROR_REGISTER, VENDOR, PRODUCT, REVISION, SERIAL)
DRIVE_NUMBERS: Final = (STATUSWORD, ERROR_CODE)
NAMES: Final = (DEVICE_NAME, HARDWARE_VERSION, SOFTWARE_VERSION)
DRIVE_PROFILE: Final = 402


class Progress(NamedTuple):
    """Progress of a survey."""

    text: str
    done_count: int
    total_count: int


@dataclass(slots=True)
class Survey:
    """Result: the traffic of all nodes, and the objects of those that answer."""

    sniffer: BusSniffer
    objects: dict[int, dict[tuple[int, int], bytes]] = field(
        default_factory=dict[int, dict[tuple[int, int], bytes]]
    )
    """Raw values by (index, sub) of each node that answered; refused objects are absent."""
    fell_silent: set[int] = field(default_factory=set[int])
    """Nodes that stopped answering."""
    not_queried: set[int] = field(default_factory=set[int])
    """Nodes without a request, because no frame leaves this station."""


Steps = Generator[Progress, None, None]


def survey(bus: Bus, clock: Clock, bitrate_bit_per_s: int) -> Generator[Progress, None, Survey]:
    """Survey a bus; the generator's return value is the result.

    Raises:
        BusError: the interface is down, or the controller is bus-off.
    """
    found = Survey(BusSniffer())
    traffic = SniffedBus(bus, clock, found.sniffer)
    pause_ns = PAUSE_FRAMES * FRAME_BITS * 1_000_000_000 // bitrate_bit_per_s
    yield from listen(traffic, clock, LISTEN_NS)
    yield from _query_all(traffic, clock, found, pause_ns)
    yield from listen(traffic, clock, ANSWER_NS, "collecting answers", len(NODES))
    port = Configurator(traffic, clock)
    present = [node_id for node_id in NODES if found.sniffer.node(node_id).answered]
    for count, node_id in enumerate(present):
        yield Progress(f"reading node {node_id}", count, len(present))
        _read(node_id, port, found, pause_ns)
    return found


def listen(
    bus: Bus, clock: Clock, duration_ns: int, text: str = "listening", done_count: int = 0
) -> Steps:
    """Receive in slices.

    Raises:
        BusError: the bus is down.
    """
    end_ns = clock.now_ns() + duration_ns
    while clock.now_ns() < end_ns:
        _receive_until(bus, clock, min(end_ns, clock.now_ns() + SLICE_NS))
        yield Progress(text, done_count, len(NODES))


def _receive_until(bus: Bus, clock: Clock, until_ns: int) -> None:
    while clock.now_ns() < until_ns:
        bus.receive_until(until_ns, clock)


def _query_all(bus: Bus, clock: Clock, found: Survey, pause_ns: int) -> Steps:
    for node_id in NODES:
        deadline_ns = clock.now_ns() + SEND_TIMEOUT_NS
        left = bus.send_urgent((upload_request(node_id, *DEVICE_TYPE),), deadline_ns, clock)
        if left or found.sniffer.is_not_acknowledged:
            found.not_queried.update(range(node_id + 1 - left, NODES.stop))
            return
        _receive_until(bus, clock, clock.now_ns() + pause_ns)
        yield Progress("asking", node_id, len(NODES))


def _read(node_id: int, port: Configurator, found: Survey, pause_ns: int) -> None:
    objects = found.objects[node_id] = {}
    try:
        for place in NUMBERS:
            _read_one(node_id, place, port, objects, pause_ns)
        if profile_number(objects) == DRIVE_PROFILE:
            for place in DRIVE_NUMBERS:
                _read_one(node_id, place, port, objects, pause_ns)
        for place in NAMES:
            if not found.sniffer.node(node_id).foreign_request_count:  # rule 3
                _read_one(node_id, place, port, objects, pause_ns)
    except SdoTimeout:
        found.fell_silent.add(node_id)


def _read_one(
    node_id: int,
    place: tuple[int, int],
    port: Configurator,
    objects: dict[tuple[int, int], bytes],
    pause_ns: int,
) -> None:
    try:
        objects[place] = port.read(node_id, *place)
    except (SdoAborted, SdoGarbled):
        return  # an object that the drive lacks is absent from the result
    finally:
        end_ns = port.now_ns() + pause_ns
        while port.now_ns() < end_ns:
            port.wait(end_ns)


def profile_number(objects: dict[tuple[int, int], bytes]) -> int | None:
    """Device profile of a node: the low word of 1000h; None if it was not read."""
    device_type = objects.get(DEVICE_TYPE)
    return None if device_type is None else int.from_bytes(device_type[:2], "little")
