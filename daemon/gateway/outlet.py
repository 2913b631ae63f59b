"""The interface through which the gateway publishes messages."""

from typing import Protocol

import msgspec
from gaitd_client import wire


class Outlet(Protocol):
    """Publisher of messages: `publish.ZenohOutlet`, or a list in a test."""

    def next_seq(self, *parts: str) -> int:
        """The next sequence number of a key."""
        ...

    def put(self, message: msgspec.Struct, *parts: str) -> None:
        """Publish a message under the key made of `parts`."""
        ...

    def put_event(self, event: wire.Event) -> None:
        """Publish an event and keep it for late joiners."""
        ...

    def links(self) -> list[tuple[str, str, str | None]]:
        """Protocol, address of the client, and common name of its certificate of each live link."""
        ...

    def set_alive(self, alive: bool) -> None:
        """Hold the liveliness token while `alive` is true, else release it."""
        ...
