"""Where messages go, as those who write them see it."""

from typing import Protocol

import msgspec

from daemon import wire


class Outlet(Protocol):
    """Where messages go; `publish.ZenohOutlet`, or a list in a test."""

    def next_seq(self, *parts: str) -> int:
        """The next sequence number of a key."""
        ...

    def put(self, message: msgspec.Struct, *parts: str) -> None:
        """Publish."""
        ...

    def put_event(self, event: wire.Event) -> None:
        """Publish an event and keep it for late joiners."""
        ...

    def show_alive(self, alive: bool) -> None:
        """Hold the liveliness token or let it go."""
        ...
