"""The wire between master and virtual drives, with a sniffer and random loss of frames.

`LossyWorld` stands where the lock-step bus expects a world. The sniffer receives the frames of the
master and of the drives before any is lost; single frames are then dropped in both directions, as
by a loose connector. The loss has its own random numbers, so that the same seed loses the same
frames.
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
    """A world whose frames are recorded and partly dropped."""

    def __init__(self, world: World, thief: random.Random, on_sent: Listener) -> None:
        self.world = world
        self.loss_ratio = 0.0
        """Share of lost PDO and SYNC frames."""
        self.stolen_count = 0
        self._thief = thief
        self._on_sent = on_sent

    @property
    def now_ns(self) -> int:
        """The world's time."""
        return self.world.now_ns

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
        if self.loss_ratio == 0.0 or can_id >= NEVER_DROPPED:
            return False
        stolen = self._thief.random() < self.loss_ratio
        self.stolen_count += stolen
        return stolen
