"""One leg of the virtual machine: a plant and its two nodes, simulated from event to event.

Legs interact on the bus alone, so between two frames from outside each runs by itself. An event is
a timer of a node, a scheduled fault, or a flag for which the plant stops; delayed frames wait in
the outbox. Nothing here reads a clock.
"""

import heapq
import random
from collections.abc import Callable, Mapping
from itertools import count
from typing import Final, NamedTuple

from drives.canopen.frame import Frame
from sim_drives.canopen.dictionary import Entry
from sim_drives.canopen.timers import NEVER
from sim_drives.faults.rules import RULES
from sim_drives.faults.script import FaultOrder
from sim_drives.node import Node
from sim_drives.plant.port import Axis, Plant
from sim_drives.settings import DriveSettings, FaultKind

SYNC_ID: Final = 0x080
NS_PER_S: Final = 1_000_000_000


class Outsider(NamedTuple):
    """A drive on the bus that is not simulated here: its axis moves as its frames say."""

    can_id: int
    """Its TPDO with the position."""
    position_si: Callable[[bytes], float | None]
    """Position of the joint in that frame; None if it holds none."""
    period_s: float
    """Period of the SYNCs."""


class Leg(NamedTuple):
    """The parts of one leg."""

    name: str
    plant: Plant
    """The plant, at the world's start time."""
    hip: DriveSettings
    hip_entries: tuple[Entry, ...]
    """EDS entries for the node id."""
    slide: DriveSettings
    slide_entries: tuple[Entry, ...]


class _Running(NamedTuple):
    """An active fault."""

    number: int
    """Identifies the scheduled end, so that the end of an older fault does not end this one."""
    value: float


class _Line:
    """One node's access to the bus."""

    def __init__(self, leg: "OneLeg", name: str) -> None:
        self._leg = leg
        self._name = name

    @property
    def now_ns(self) -> int:
        return self._leg.now_ns

    def send(self, frame: Frame, *, delay_ns: int = 0) -> None:
        self._leg.put_on_bus(self._name, frame, delay_ns)


class OneLeg:
    """Two nodes and their plant."""

    def __init__(self, leg: Leg, seed: int, start_ns: int) -> None:
        self.now_ns = start_ns
        self._plant = leg.plant
        self._order = count()
        self._outbox: list[tuple[int, int, str, Frame]] = []
        self._agenda: list[tuple[int, int, FaultOrder]] = []
        self._led: dict[int, tuple[int, Callable[[bytes], float | None]]] = {}
        self._sync_ns = start_ns
        self._running: dict[tuple[str, FaultKind], _Running] = {}
        parts = (("hip", leg.hip, leg.hip_entries), ("slide", leg.slide, leg.slide_entries))
        self.nodes = {
            f"{leg.name}/{axis}": Node(
                f"{leg.name}/{axis}",
                settings,
                entries,
                Axis(leg.plant, number),
                _Line(self, f"{leg.name}/{axis}"),
                random.Random(f"{seed}/{leg.name}/{axis}"),
            )
            for number, (axis, settings, entries) in enumerate(parts)
        }
        self._hip_timers, self._slide_timers = (node.timers for node in self.nodes.values())
        self._flags = [0 for _ in self.nodes]

    def power_on(self, outsiders: Mapping[str, Outsider]) -> None:
        """Power the drives on; those of `outsiders` stay without power and send nothing."""
        for number, (name, node) in enumerate(self.nodes.items()):
            if name not in outsiders:
                node.power_on()
                continue
            self._plant.lead(number, outsiders[name].period_s)
            self._led[outsiders[name].can_id] = number, outsiders[name].position_si

    # --- the bus ------------------------------------------------------------------------------

    def receive(self, frame: Frame) -> None:
        """Deliver a frame to both nodes now, and an outsider's position to the plant."""
        for node in self.nodes.values():
            node.receive(frame)
        if frame.can_id == SYNC_ID:
            self._sync_ns = self.now_ns
        elif frame.can_id in self._led:
            axis, position_of = self._led[frame.can_id]
            position_si = position_of(frame.data)
            if position_si is not None:
                self._plant.follow(axis, self._sync_ns, position_si)

    def put_on_bus(self, drive: str, frame: Frame, delay_ns: int) -> None:
        """Put a node's frame on the bus `delay_ns` from now."""
        heapq.heappush(self._outbox, (self.now_ns + delay_ns, next(self._order), drive, frame))

    # --- time ---------------------------------------------------------------------------------

    def advance_to(self, time_ns: int) -> list[Frame]:
        """Advance to `time_ns`; return the frames up to and including it, by time."""
        sent: list[Frame] = []
        while True:
            self._advance_plant(min(self._next_deadline_ns(), time_ns))
            self._release(sent)  # before a fault that begins now can delay them
            if self._next_deadline_ns() <= self.now_ns:
                self._run_due()
            elif self.now_ns == time_ns:
                return sent

    def next_event_ns(self) -> int:
        """Return the time of the next event, or NEVER; flags of the plant not included."""
        return min(self._next_deadline_ns(), self._outbox[0][0] if self._outbox else NEVER)

    def _next_deadline_ns(self) -> int:
        hip_ns, slide_ns = self._hip_timers.next_ns, self._slide_timers.next_ns
        timers_ns = hip_ns if hip_ns < slide_ns else slide_ns
        return min(timers_ns, self._agenda[0][0]) if self._agenda else timers_ns

    def _advance_plant(self, time_ns: int) -> None:
        """Advance the plant to `time_ns`, or until it raises a flag, which the nodes process."""
        plant = self._plant
        self.now_ns = plant.advance(max(time_ns, self.now_ns))
        for number, node in enumerate(self.nodes.values()):
            flags = plant.flags(number)
            if flags != self._flags[number]:
                self._flags[number] = flags
                node.changed()

    def _run_due(self) -> None:
        while self._agenda and self._agenda[0][0] <= self.now_ns:
            _, number, order = heapq.heappop(self._agenda)
            running = self._running.get((order.drive, order.kind))
            if not order.clear or (running is not None and running.number == number):
                self.inject(order)
        for node in self.nodes.values():
            if node.timers.next_ns <= self.now_ns:
                node.run_timers(self.now_ns)

    def _release(self, sent: list[Frame]) -> None:
        """Add the frames that are due now."""
        while self._outbox and self._outbox[0][0] <= self.now_ns:
            time_ns, _, drive, frame = heapq.heappop(self._outbox)
            if self.nodes[drive].reaches_bus(frame, time_ns):
                sent.append(Frame(frame.can_id, frame.data, time_ns))

    # --- faults -------------------------------------------------------------------------------

    def plan(self, at_ns: int, order: FaultOrder) -> None:
        """Schedule a fault."""
        heapq.heappush(self._agenda, (at_ns, next(self._order), order))

    def inject(self, order: FaultOrder) -> None:
        """Begin or clear a fault of one of this leg's drives now."""
        self._end(order.drive, order.kind)
        if not order.clear:
            self._begin(order)

    def _begin(self, order: FaultOrder) -> None:
        node, rule = self.nodes[order.drive], RULES[order.kind]
        rule.switch(node, order.value, True)
        node.changed()
        number = next(self._order)
        self._running[order.drive, order.kind] = _Running(number, order.value)
        if order.duration_s is not None:
            at_ns = self.now_ns + round(order.duration_s * NS_PER_S)
            end = FaultOrder(order.drive, order.kind, clear=True)
            heapq.heappush(self._agenda, (at_ns, number, end))
        elif rule.momentary:
            self._end(order.drive, order.kind)

    def _end(self, drive: str, kind: FaultKind) -> None:
        running = self._running.pop((drive, kind), None)
        if running is not None:
            RULES[kind].switch(self.nodes[drive], running.value, False)
            self.nodes[drive].changed()
