"""The wire between master and virtual drives, with a sniffer and random loss of frames.

`LossyWorld` stands where the lock-step bus expects a world. The sniffer receives the frames of the
master before any is lost; single frames are then dropped in both directions, as by a loose
connector. The same seed loses the same frames.
"""

import random
from collections.abc import Callable
from typing import Final

from drives.canopen.frame import Frame
from sim_drives.world import World

Listener = Callable[[int, int, bytes], None]
"""Time in ns, COB-ID, data."""

NEVER_DROPPED: Final = 0x600
"""SDO and heartbeats from this COB-ID on are not dropped: a bring-up would only take longer."""


class LossyWorld:
    """A world whose frames are observed and partly dropped."""

    def __init__(self, world: World, on_sent: Listener) -> None:
        self.world = world
        self._on_sent = on_sent
        self._loss_ratio = 0.0
        self._until_ns = 0
        self._rng = random.Random()

    @property
    def now_ns(self) -> int:
        """The world's time."""
        return self.world.now_ns

    def lose(self, loss_ratio: float, until_ns: int, seed: int) -> None:
        """Drop a share of the PDO and SYNC frames until a time."""
        self._loss_ratio, self._until_ns = loss_ratio, until_ns
        self._rng = random.Random(seed)

    def receive(self, frame: Frame) -> None:
        """Deliver a frame of the master to the drives, unless it is lost."""
        self._on_sent(self.now_ns, frame.can_id, frame.data)
        if not self._is_dropped(frame.can_id):
            self.world.receive(frame)

    def advance_to(self, time_ns: int) -> list[Frame]:
        """Return the frames that the drives have sent until then, without the lost ones."""
        frames = self.world.advance_to(time_ns)
        return [frame for frame in frames if not self._is_dropped(frame.can_id)]

    def next_event_ns(self) -> int:
        """Return the world's next event time."""
        return self.world.next_event_ns()

    def _is_dropped(self, can_id: int) -> bool:
        if self.now_ns >= self._until_ns or can_id >= NEVER_DROPPED:
            return False
        return self._rng.random() < self._loss_ratio
