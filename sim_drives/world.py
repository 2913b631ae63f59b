"""The virtual machine in lock-step: all nodes, all plants, one time; frames in, frames out.

`World` has no thread and no clock: its time is the argument of `advance_to`. The same settings,
seed and calls give the same frames, bit for bit.

    world = World(legs, faults, seed=1)
    world.advance_to(t)               time passes; returns the frames sent by the drives until then
    world.receive(Frame(0x080, b""))  a frame of the master's arrives now
    world.advance_to(t + 1_000_000)   TPDOs with their latency, SDO answers, heartbeats, EMCY
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from drives.canopen.frame import Frame
from sim_drives.canopen.timers import NEVER
from sim_drives.faults.script import (
    EVERY_DRIVE,
    FaultCommandError,
    FaultOrder,
    check_value,
    parse_command,
)
from sim_drives.node import Node
from sim_drives.one_leg import NS_PER_S, SYNC_ID, Leg, OneLeg, Outsider
from sim_drives.settings import FaultSettings

NO_OUTSIDERS: Final[Mapping[str, Outsider]] = MappingProxyType({})


class World:
    """Virtual drives with the machine behind them."""

    def __init__(
        self,
        legs: Sequence[Leg],
        faults: Sequence[FaultSettings] = (),
        *,
        seed: int,
        start_ns: int = 0,
        on_sync: Callable[[int], None] | None = None,
        outsiders: Mapping[str, Outsider] = NO_OUTSIDERS,
    ) -> None:
        """Build the machine and power it on.

        Args:
            legs: their plants are at rest at `start_ns`; none if no drive is simulated here.
            faults: the script; times count from `start_ns`.
            seed: seed of the TPDO latencies; the plants have seeds of their own.
            start_ns: the world's first time.
            on_sync: called at each SYNC with its number from 1, the plants being at its time.
            outsiders: the drives, LEG/AXIS, that are not simulated here.

        Raises:
            FaultCommandError: the script names a drive that does not exist, or a wrong value.
        """
        self.now_ns = start_ns
        """The world's time; no property, because a cycle asks for it some sixty times."""
        self._on_sync = on_sync
        self._sync_count = 0
        self._legs = [OneLeg(leg, seed, start_ns) for leg in legs]
        self._home = {
            name: leg for leg in self._legs for name in leg.nodes if name not in outsiders
        }
        for fault in faults:
            self._plan(fault)
        for leg in self._legs:
            leg.power_on(outsiders)

    @property
    def sync_count(self) -> int:
        """Number of SYNCs so far."""
        return self._sync_count

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of the drives, LEG/AXIS."""
        return tuple(self._home)

    def node(self, drive: str) -> Node:
        """Return one node by the name of its drive, for inspection."""
        return self._home[drive].nodes[drive]

    def receive(self, frame: Frame) -> None:
        """Deliver a frame of the master, or of another node, to every node now."""
        for leg in self._legs:
            leg.receive(frame)
        if frame.can_id == SYNC_ID:
            self._sync_count += 1
            if self._on_sync is not None:
                self._on_sync(self._sync_count)

    def advance_to(self, time_ns: int) -> list[Frame]:
        """Advance time; return the drives' frames on the bus up to and including `time_ns`.

        Raises:
            ValueError: `time_ns` is in the past (a bug of the caller).
        """
        if time_ns < self.now_ns:
            raise ValueError(f"the world is at {self.now_ns} ns, cannot go back to {time_ns} ns")
        sent: list[Frame] = []
        for leg in self._legs:
            sent += leg.advance_to(time_ns)
        self.now_ns = time_ns
        if len(sent) > 1:
            sent.sort(key=lambda frame: frame.time_ns)
        return sent

    def next_event_ns(self) -> int:
        """Return the time of the next event, or timers.NEVER; the plants may report earlier."""
        next_ns = NEVER
        for leg in self._legs:
            next_ns = min(next_ns, leg.next_event_ns())
        return next_ns

    # --- faults -------------------------------------------------------------------------------

    def command(self, line: str) -> str:
        """Execute one line of text (see `script.py`); returns what has been done.

        Raises:
            FaultCommandError: the line is invalid; the message gives the reason.
        """
        order = parse_command(line)
        self.inject(order)
        return f"{'cleared' if order.clear else 'began'} {order.kind.value} on {order.drive}"

    def inject(self, order: FaultOrder) -> None:
        """Begin or clear a fault now; drive `*` means each.

        Raises:
            FaultCommandError: there is no such drive.
        """
        for name in self._named(order.drive):
            self._home[name].inject(order.on(name))

    def _plan(self, fault: FaultSettings) -> None:
        check_value(fault.kind, fault.value)
        at_ns = self.now_ns + round(fault.at_s * NS_PER_S)
        order = FaultOrder(fault.drive, fault.kind, fault.duration_s, fault.value)
        for name in self._named(fault.drive):
            self._home[name].plan(at_ns, order.on(name))

    def _named(self, drive: str) -> tuple[str, ...]:
        if drive == EVERY_DRIVE:
            return self.drives
        if drive not in self._home:
            known = ", ".join(self.drives)
            raise FaultCommandError(f"unknown drive {drive!r}; known: {known}, {EVERY_DRIVE}")
        return (drive,)
