"""Messages of the trainer to the pages: one computation for all, and a bounded queue for each page.

Each tick the board returns the newest view, which replaces the one that waits. Items (strides,
events) must not be lost by a page that is only slow, so they have a queue, whose oldest item goes
if it is full. A page acknowledges each frame; without acknowledgement at most `WINDOW` frames are
on their way. So a page that does not read (a hidden tab, a suspended tablet) costs no memory, and
gets the present instead of a burst of the past when it reads again.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Final, TypeVar

import msgspec
from gaitd_client import NotValid, Stream

T = TypeVar("T", bound=msgspec.Struct)

TICK_S: Final = 1 / 60
LATE_S: Final = 0.1
"""A server that wakes so late has been busy or suspended: it receives first what waits for it, and
then judges whether the trainer is silent."""
WINDOW: Final = 2
"""Frames that may be on their way to a page: more would be old when they are painted."""
ITEMS_MAX: Final = 256
PAGES_MAX: Final = 16


class TooManyPagesError(Exception):
    """`PAGES_MAX` pages are connected."""


class PageQueue:
    """What waits for one page."""

    def __init__(self, items: tuple[bytes, ...]) -> None:
        """Start with items of the past."""
        self._view: bytes | None = None
        self._items = deque(items, maxlen=ITEMS_MAX)
        self._changed = asyncio.Event()
        self._sent_seq = self._received_seq = 0

    def offer(self, view: bytes) -> None:
        """Replace the view that waits."""
        self._view = view
        self._changed.set()

    def add(self, item: bytes) -> None:
        """Append an item; the oldest goes if the queue is full."""
        self._items.append(item)

    def acknowledge(self, seq: int) -> None:
        """Take note that the page has the frame of this number.

        Raises:
            ValueError: a frame that was not sent.
        """
        if not self._received_seq <= seq <= self._sent_seq:
            raise ValueError(f"frame {seq} of {self._sent_seq}")
        self._received_seq = seq
        self._changed.set()

    async def next(self) -> str:
        """Wait for a view and for room on the way to the page; return the frame."""
        while self._view is None or self._sent_seq - self._received_seq >= WINDOW:
            self._changed.clear()
            await self._changed.wait()
        self._sent_seq += 1
        frame = b'{"seq":%d,"now":%s,"items":[%s]}' % (
            self._sent_seq,
            self._view,
            b",".join(self._items),
        )
        self._view = None
        self._items.clear()
        return frame.decode()


class Feed:
    """All pages of one server."""

    def __init__(self, view: Callable[[], msgspec.Struct]) -> None:
        """Start without a page.

        Args:
            view: returns the present view; called each tick.
        """
        self._view = view
        self._encoder = msgspec.json.Encoder()
        self._pages: set[PageQueue] = set()
        self._past: deque[bytes] = deque(maxlen=ITEMS_MAX)

    @property
    def page_count(self) -> int:
        """Number of connected pages."""
        return len(self._pages)

    def join(self) -> PageQueue:
        """Add a page; it gets the items of the past first.

        Raises:
            TooManyPagesError: so many are connected already.
        """
        if len(self._pages) >= PAGES_MAX:
            raise TooManyPagesError(f"{PAGES_MAX} pages are connected; close one")
        page = PageQueue(tuple(self._past))
        self._pages.add(page)
        return page

    def leave(self, page: PageQueue) -> None:
        """Remove a page."""
        self._pages.discard(page)

    def add(self, item: msgspec.Struct) -> None:
        """Send an item to all pages, and keep it for those that come later."""
        encoded = self._encoder.encode(item)
        self._past.append(encoded)
        for page in self._pages:
            page.add(encoded)

    async def follow(self, stream: Stream[T], item_of: Callable[[T], msgspec.Struct]) -> None:
        """Send an item for each message of a stream, until it is closed."""
        async for message in stream:
            if not isinstance(message, NotValid):
                self.add(item_of(message))

    def tick(self) -> None:
        """Offer the present view to all pages."""
        view = self._encoder.encode(self._view())
        for page in self._pages:
            page.offer(view)

    async def run(self) -> None:
        """Tick until cancelled."""
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            self.tick()
            now_s = loop.time()
            due_s = max(due_s + TICK_S, now_s)  # a tick that was missed is not caught up
            await asyncio.sleep(due_s - now_s)
            if loop.time() - due_s > LATE_S:
                await asyncio.sleep(TICK_S)
