"""What enters over Zenoh without an answer: setpoints, put into a box by Zenoh's threads."""

import zenoh

from daemon import wire
from daemon.gateway.setpoints import SETPOINT_SIZE_MAX, SetpointBox

TOO_LARGE = b" " * (SETPOINT_SIZE_MAX + 1)
"""Stands for a payload that nobody keeps, because of its size."""


class SetpointSubscriber:
    """Hears LEG/setpoint of one trainer, whatever LEG is."""

    def __init__(self, session: zenoh.Session, trainer: str, box: SetpointBox) -> None:
        self._box = box
        self._subscriber = session.declare_subscriber(
            wire.key(trainer, "*", wire.SETPOINT), self._hear
        )

    def _hear(self, sample: zenoh.Sample) -> None:
        """Called in a thread of Zenoh."""
        payload = sample.payload
        small = len(payload) <= SETPOINT_SIZE_MAX
        leg = str(sample.key_expr).rsplit("/", 2)[-2]
        self._box.put(leg, payload.to_bytes() if small else TOO_LARGE)

    def close(self) -> None:
        """Undeclare; the box is the caller's."""
        self._subscriber.undeclare()
