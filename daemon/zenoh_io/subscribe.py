"""Subscriber for setpoints: Zenoh's threads put them into a box that the loop drains."""

import zenoh
from gaitd_client import wire

from daemon.gateway.setpoints import SETPOINT_SIZE_MAX, SetpointBox
from daemon.zenoh_io.callbacks import Callbacks

TOO_LARGE = b" " * (SETPOINT_SIZE_MAX + 1)
"""Placeholder for a payload that is too large to keep."""


class SetpointSubscriber:
    """Receives LEG/setpoint of one trainer, for any LEG."""

    def __init__(self, session: zenoh.Session, trainer: str, box: SetpointBox) -> None:
        self._box = box
        key = wire.key(trainer, "*", wire.SETPOINT)
        self._callbacks = Callbacks(self._receive)
        self._subscriber = session.declare_subscriber(key, self._callbacks.handler)

    def _receive(self, sample: zenoh.Sample) -> None:
        """Put one message into the box; called in a thread of Zenoh."""
        payload = sample.payload
        small = len(payload) <= SETPOINT_SIZE_MAX
        leg = str(sample.key_expr).rsplit("/", 2)[-2]
        self._box.put(leg, payload.to_bytes() if small else TOO_LARGE)

    def close(self) -> None:
        """Undeclare the subscriber; the box remains open, and nothing is put into it any more."""
        self._subscriber.undeclare()
        self._callbacks.wait()
