"""Two CAN adapters on USB, which the kernel drives by its own `usb_8dev`: the controllers of
`can_wire.py`, with all that a kernel's driver has to say of errors, bus-off and restart.

No hardware and no gadget: `vhci-hcd` is a USB host whose devices live behind a socket. What goes
over it is USB/IP (Documentation/usb/usbip_protocol.rst), here between the kernel and a process
beside it. The adapter is the "USB2CAN converter" of 8 devices; its messages:

    endpoint 4 and 3     a command and its answer: 11h, 0, command, 2 options, 10 bytes, 22h
    endpoint 2           a frame to be sent: 55h, flags, identifier, length, 8 bytes, AAh
    endpoint 1           a frame that came, or a change of state: 55h, type, flags, ..., time, AAh

A frame for which the controller has no room stays with the kernel until it has: that is how an
interface's queue fills up.
"""

import os
import select
import socket
import struct
import time
import traceback
from collections import defaultdict, deque
from pathlib import Path
from typing import NoReturn

from can_wire import Controller, State, connect

HOST = Path("/sys/devices/platform/vhci_hcd.0")
FULL_SPEED = 2
DEVICE_ID = 0x10001
"""Any but 0."""
CHUNK = 65536
TIMEOUT_S, POLL_S = 120.0, 0.1
"""Until both are there."""

# --- USB ----------------------------------------------------------------------------------------

CONTROL, FRAMES_IN, FRAMES_OUT, ANSWERS, COMMANDS = range(5)
GET_STATUS, CLEAR_FEATURE, GET_DESCRIPTOR, SET_CONFIGURATION, SET_INTERFACE = 0, 1, 6, 9, 11
DEVICE, CONFIGURATION, LANGUAGES, PRODUCT = 0x100, 0x200, 0x300, 0x301
SETUP = struct.Struct("<BBHHH")
NAME = "USB2CAN converter"


def _descriptor(kind: int, content: bytes) -> bytes:
    return bytes((2 + len(content), kind)) + content


def _configuration() -> bytes:
    endpoints = (0x80 | FRAMES_IN, FRAMES_OUT, 0x80 | ANSWERS, COMMANDS)
    inner = _descriptor(4, bytes((0, 0, len(endpoints), 0xFF, 0, 0, 0)))
    for endpoint in endpoints:
        inner += _descriptor(5, struct.pack("<BBHB", endpoint, 2, 64, 0))
    return _descriptor(2, struct.pack("<HBBBBB", 9 + len(inner), 1, 1, 0, 0x80, 50)) + inner


DESCRIPTORS = {
    DEVICE: _descriptor(
        1, struct.pack("<HBBBBHHHBBBB", 0x110, 0xFF, 0, 0, 64, 0x0483, 0x1234, 0x100, 0, 1, 0, 1)
    ),
    CONFIGURATION: _configuration(),
    LANGUAGES: _descriptor(3, struct.pack("<H", 0x409)),
    PRODUCT: _descriptor(3, NAME.encode("utf-16-le")),
}

# --- USB/IP -------------------------------------------------------------------------------------

HEADER = struct.Struct(">5I")
"""Command, number, device, direction (1: to the host), endpoint."""
SUBMIT = struct.Struct(">IIIII8s")
"""Flags, length, and of a control transfer the setup packet."""
RETURN = struct.Struct(">iiIII8x")
"""Status and length."""
UNLINK = struct.Struct(">I24x")
UNLINKED = struct.Struct(">i24x")
SIZE = HEADER.size + SUBMIT.size
CMD_SUBMIT, CMD_UNLINK, RET_SUBMIT, RET_UNLINK = 1, 2, 3, 4
STALLED, CANCELLED = -32, -104


def plug_in(port: int) -> socket.socket:
    """The end of a socket that the kernel takes for a device in this port."""
    near, far = socket.socketpair()
    with far:
        (HOST / "attach").write_text(f"{port} {far.fileno()} {DEVICE_ID} {FULL_SPEED}")
    return near


class UsbDevice:
    """Answers control transfers; keeps the others until there is something for them."""

    def __init__(self, near: socket.socket) -> None:
        """At the far end of the socket is a host."""
        self.near = near
        self._came = b""
        self._wanted: defaultdict[int, deque[tuple[int, int]]] = defaultdict(deque)
        """For each endpoint, what the host is ready to take: number and length."""
        self._said: defaultdict[int, deque[bytes]] = defaultdict(deque)
        self.given: deque[tuple[int, int, bytes]] = deque()
        """Endpoint, number and content of what the host gives, until `accept`."""

    def read(self) -> None:
        """Take what the host has sent."""
        came = self.near.recv(CHUNK)
        if not came:
            raise ConnectionError("the kernel has unplugged an adapter")
        self._came += came
        while (size := self._first_size()) is not None:
            first, self._came = self._came[:size], self._came[size:]
            self._take(first)

    def say(self, endpoint: int, message: bytes) -> None:
        """Send a message to the host, when it asks for it."""
        self._said[endpoint].append(message)
        self._answer(endpoint)

    def accept(self, number: int, length: int) -> None:
        """What the host has given was taken."""
        self._return(number, length)

    def _first_size(self) -> int | None:
        """Length of the first request, if all of it is there."""
        if len(self._came) < SIZE:
            return None
        command, _, _, to_host, _ = HEADER.unpack_from(self._came)
        length = SUBMIT.unpack_from(self._came, HEADER.size)[1]
        size = SIZE + (length if command == CMD_SUBMIT and not to_host else 0)
        return size if len(self._came) >= size else None

    def _take(self, request: bytes) -> None:
        command, number, _, to_host, endpoint = HEADER.unpack_from(request)
        if command == CMD_UNLINK:
            self._unlink(number, UNLINK.unpack_from(request, HEADER.size)[0])
            return
        _, length, _, _, _, setup = SUBMIT.unpack_from(request, HEADER.size)
        if endpoint == CONTROL:
            self._control(number, SETUP.unpack(setup))
        elif to_host:
            self._wanted[endpoint].append((number, length))
            self._answer(endpoint)
        else:
            self.given.append((endpoint, number, request[SIZE:]))

    def _control(self, number: int, setup: tuple[int, ...]) -> None:
        _, request, value, _, length = setup
        if request == GET_DESCRIPTOR and value in DESCRIPTORS:
            self._return(number, data=DESCRIPTORS[value][:length])
        elif request == GET_STATUS:
            self._return(number, data=bytes(2))
        elif request in {CLEAR_FEATURE, SET_CONFIGURATION, SET_INTERFACE}:
            self._return(number)
        else:
            self._return(number, status=STALLED)

    def _answer(self, endpoint: int) -> None:
        wanted, said = self._wanted[endpoint], self._said[endpoint]
        while wanted and said:
            number, room = wanted.popleft()
            data = said.popleft()
            while said and len(data) + len(said[0]) <= room:
                data += said.popleft()
            self._return(number, data=data)

    def _return(self, number: int, length: int = 0, data: bytes = b"", status: int = 0) -> None:
        head = HEADER.pack(RET_SUBMIT, number, 0, 0, 0)
        self.near.sendall(head + RETURN.pack(status, length or len(data), 0, 0, 0) + data)

    def _unlink(self, number: int, other: int) -> None:
        """The host does not want a transfer any more; it may be over already."""
        before = self._count()
        for endpoint, wanted in self._wanted.items():
            self._wanted[endpoint] = deque(one for one in wanted if one[0] != other)
        self.given = deque(one for one in self.given if one[1] != other)
        status = CANCELLED if self._count() < before else 0
        self.near.sendall(HEADER.pack(RET_UNLINK, number, 0, 0, 0) + UNLINKED.pack(status))

    def _count(self) -> int:
        return len(self.given) + sum(map(len, self._wanted.values()))


# --- the adapter --------------------------------------------------------------------------------

COMMAND = struct.Struct(">BBBBB10sB")
FRAME_OUT = struct.Struct(">B14sB")
FRAME_IN = struct.Struct(">BB14sIB")
OPEN, CLOSE, VERSION = 2, 3, 12
FRAME, ERROR = 0, 3
TIMING = struct.Struct(">BBBH")
CLOCK_HZ = 32_000_000
STATUS = {State.ACTIVE: 0, State.WARNING: 2, State.PASSIVE: 3, State.BUS_OFF: 4}


class Adapter:
    """One adapter between its USB port and its controller."""

    def __init__(self, near: socket.socket) -> None:
        """At the far end of the socket is a host."""
        self.usb = UsbDevice(near)
        self.controller = Controller(self)

    def hear(self, frame: bytes) -> None:
        """A frame came from the wire."""
        self.usb.say(FRAMES_IN, FRAME_IN.pack(0x55, FRAME, frame, 0, 0xAA))

    def learn(self, state: State, errors: int) -> None:
        """The controller's state has changed."""
        told = bytes((STATUS[state], 0, min(errors, 255)))
        content = bytes((4, *bytes(4), 8)) + told.ljust(8, b"\0")
        self.usb.say(FRAMES_IN, FRAME_IN.pack(0x55, ERROR, content, 0, 0xAA))

    def go_on(self) -> None:
        """Take what the host gives, as far as there is room."""
        controller, given = self.controller, self.usb.given
        later: deque[tuple[int, int, bytes]] = deque()
        while given:
            endpoint, number, content = given.popleft()
            if endpoint == COMMANDS:
                self.usb.accept(number, len(content))
                self._do(content)
            elif controller.has_room:
                self.usb.accept(number, len(content))
                controller.send(FRAME_OUT.unpack(content)[1])
            else:
                later.append((endpoint, number, content))
        given.extend(later)

    def _do(self, content: bytes) -> None:
        _, _, command, _, _, options, _ = COMMAND.unpack(content)
        if command == OPEN:
            before, after, _, prescaler = TIMING.unpack_from(options)
            self.controller.open(CLOCK_HZ // (prescaler * (1 + before + after)))
        elif command == CLOSE:
            self.controller.close()
        told = bytes((1, 0, 1, 0)) if command == VERSION else b""
        self.usb.say(ANSWERS, COMMAND.pack(0x11, 0, command, 0, 0, told, 0x22))


def wired(one: socket.socket, other: socket.socket) -> tuple[Adapter, Adapter]:
    """Two adapters with a wire between them."""
    adapters = Adapter(one), Adapter(other)
    connect(*(adapter.controller for adapter in adapters))
    return adapters


def serve(control: int) -> NoReturn:
    """Run both adapters for good.

    `control` is a pipe that takes `break NUMBER` and `mend NUMBER`, one a line.
    """
    adapters = wired(plug_in(0), plug_in(1))
    poller = select.poll()
    for source in (control, *(adapter.usb.near.fileno() for adapter in adapters)):
        poller.register(source, select.POLLIN)
    while True:
        ready = {source for source, _ in poller.poll()}
        for adapter in adapters:
            if adapter.usb.near.fileno() in ready:
                adapter.usb.read()
        for adapter in adapters:
            adapter.go_on()
        if control in ready:
            ordered = os.read(control, CHUNK).decode().split()
            for word, number in zip(ordered[::2], ordered[1::2], strict=True):
                adapters[int(number)].controller.broken = word == "break"
            if not ordered:
                poller.unregister(control)


def _serve_and_exit(control: int) -> NoReturn:
    """A fork must not come back into its parent's story."""
    try:
        serve(control)
    except Exception as failure:
        traceback.print_exception(failure)
        raise
    finally:
        os._exit(1)


class Wire:
    """Both adapters and the wire in a process of their own, until the computer is shut down.

    They are never unplugged: `usb_8dev` of Linux 6.1 frees its buffers twice when an adapter goes
    that was open, and takes the kernel with it.
    """

    def __init__(self) -> None:
        reading, self._orders = os.pipe()
        if os.fork() == 0:
            os.close(self._orders)
            _serve_and_exit(reading)
        os.close(reading)
        self.interfaces = _interface(0), _interface(1)
        """As the kernel calls them."""

    def order(self, words: str) -> None:
        """`break NUMBER` or `mend NUMBER`."""
        os.write(self._orders, words.encode() + b"\n")


def _interface(port: int) -> str:
    for _ in range(round(TIMEOUT_S / POLL_S)):
        for path in HOST.glob(f"usb*/*-{port + 1}/*:1.0/net/*"):
            return path.name
        time.sleep(POLL_S)
    raise AssertionError(f"no interface came up for the adapter in port {port}")
