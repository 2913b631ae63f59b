"""Publishers, the token `alive`, and queries to control/* on Zenoh.

Nothing here blocks: publishers drop messages, and the callback of a query, which runs in a thread
of Zenoh, only puts the query into a mailbox that wakes the loop.
"""

import contextlib
import os
import threading
from collections import Counter
from typing import Final, NamedTuple

import msgspec
import zenoh
from gaitd_client import wire
from zenoh import CongestionControl, Priority
from zenoh.ext import (
    AdvancedPublisher,
    CacheConfig,
    MissDetectionConfig,
    declare_advanced_publisher,
)

from daemon.gateway.events import HISTORY_COUNT
from daemon.gateway.requests import QUERY_SIZE_MAX
from daemon.zenoh_io.access import QUERYABLES
from daemon.zenoh_io.callbacks import Callbacks

WAITING_COUNT_MAX: Final = 64
"""Queries that may wait for the loop, and as many stops of each client.

A stop is dropped only while so many of the same client wait, so the machine stops in any case.
"""

EVENT_HEARTBEAT_S: Final = 1.0
"""Interval at which the newest event's number is published, so that subscribers notice a loss."""


class ZenohInquiry:
    """One query to control/NAME, or to control/NAME/CLIENT of a client with keys."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query
        self._key = str(query.key_expr)
        # gaitd/TRAINER/control/NAME or .../NAME/CLIENT; a TRAINER may be called `control`, too.
        self.name, _, self.identity = self._key.split("/", 3)[-1].partition("/")
        # One byte more than allowed is enough to refuse it, and bounds the memory used.
        self.payload = query.payload.to_bytes()[: QUERY_SIZE_MAX + 1] if query.payload else b""

    def answer(self, message: msgspec.Struct, *, failed: bool = False) -> None:
        """Send the only reply and finish the query; ignores errors, as the client may be gone."""
        data, encoding = msgspec.json.encode(message), wire.encoding(type(message))
        with contextlib.suppress(zenoh.ZError):
            if failed:
                self._query.reply_err(data, encoding=encoding)
            else:
                self._query.reply(self._key, data, encoding=encoding)
        self._query.drop()


class Mailbox:
    """Queue of queries from Zenoh's threads to the loop."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[ZenohInquiry] = []
        self._counts: Counter[str | None] = Counter()
        """Waiting stops by client, and all other queries under None."""
        self._fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self.dropped_count = 0

    def fileno(self) -> int:
        """File descriptor for poll(): readable while a query waits."""
        return self._fd

    def put(self, query: zenoh.Query) -> None:
        """Add a query; called in a thread of Zenoh."""
        inquiry = ZenohInquiry(query)
        counted = inquiry.identity if inquiry.name == "stop" else None
        with self._lock:
            has_room = self._counts[counted] < WAITING_COUNT_MAX
            if has_room:
                self._counts[counted] += 1
                self._waiting.append(inquiry)
            else:
                self.dropped_count += 1
        if has_room:
            os.eventfd_write(self._fd, 1)
        else:
            query.drop()

    @property
    def is_empty(self) -> bool:
        """True if no query waits."""
        return not self._waiting

    def drain(self) -> list[ZenohInquiry]:
        """Queries that wait now, oldest first; later ones wake the loop again."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._fd)
        with self._lock:
            waiting, self._waiting = self._waiting, []
            self._counts.clear()
        return waiting

    def close(self) -> None:
        """Close the file descriptor; no callback may run any more."""
        os.close(self._fd)


class Quality(NamedTuple):
    """Zenoh's quality of service for the messages of a key."""

    priority: Priority = Priority.DATA
    express: bool = False
    """Sent at once, not batched with the next messages."""


ESTIMATE: Final = Quality(Priority.REAL_TIME, express=True)
"""Real-time priority, because a controller waits for it; Zenoh has a queue of its own for it."""
SAFETY: Final = Quality(Priority.INTERACTIVE_HIGH)
OTHER: Final = Quality()


def declare(
    session: zenoh.Session, key: str, message: type[msgspec.Struct], quality: Quality
) -> zenoh.Publisher:
    """Declare a publisher of messages of this type that drops messages rather than waits."""
    return session.declare_publisher(
        key,
        encoding=wire.encoding(message),
        congestion_control=CongestionControl.DROP,
        priority=quality.priority,
        express=quality.express,
    )


def _quality(parts: tuple[str, ...]) -> Quality:
    if parts == (wire.SAFETY,):
        return SAFETY
    return ESTIMATE if parts[-1] == "estimate" else OTHER


class ZenohOutlet:
    """All publishers of one trainer, declared when first used."""

    def __init__(self, session: zenoh.Session, trainer: str, mailbox: Mailbox) -> None:
        self._session = session
        self._trainer = trainer
        self._publishers: dict[tuple[str, ...], zenoh.Publisher] = {}
        self._seqs: dict[tuple[str, ...], int] = {}
        self._encoder = msgspec.json.Encoder()
        self._token: zenoh.LivelinessToken | None = None
        self._events = self._declare_events()
        self._callbacks = [Callbacks(mailbox.put) for _ in QUERYABLES]
        self._queryables = [
            session.declare_queryable(wire.key(trainer, key), callbacks.handler)
            for key, callbacks in zip(QUERYABLES, self._callbacks, strict=True)
        ]

    def next_seq(self, *parts: str) -> int:
        """The next sequence number of a key."""
        self._seqs[parts] = self._seqs.get(parts, 0) + 1
        return self._seqs[parts]

    def put(self, message: msgspec.Struct, *parts: str) -> None:
        """Publish a message on a key below gaitd/TRAINER/."""
        publisher = self._publishers.get(parts)
        if publisher is None:
            key = wire.key(self._trainer, *parts)
            publisher = declare(self._session, key, type(message), _quality(parts))
            self._publishers[parts] = publisher
        publisher.put(self._encoder.encode(message))

    def put_event(self, event: wire.Event) -> None:
        """Publish an event and keep it for late joiners."""
        self._events.put(msgspec.json.encode(event))

    def links(self) -> list[tuple[str, str, str | None]]:
        """See `Outlet`."""
        found: list[tuple[str, str, str | None]] = []
        for link in self._session.info.links():
            protocol, _, address = str(link.dst).partition("/")
            found.append((protocol, address, link.auth_identifier))
        return found

    def set_alive(self, alive: bool) -> None:
        """Hold the liveliness token while `alive` is true, else release it."""
        if alive and self._token is None:
            key = wire.key(self._trainer, wire.ALIVE)
            self._token = self._session.liveliness().declare_token(key)
        elif not alive and self._token is not None:
            self._token.undeclare()
            self._token = None

    def end_queries(self) -> None:
        """Receive no more queries; those that had arrived are in the mailbox then."""
        while self._queryables:
            self._queryables.pop().undeclare()
        for callbacks in self._callbacks:
            callbacks.wait()

    def close(self) -> None:
        """Undeclare everything; the session remains open."""
        self.set_alive(False)
        self.end_queries()
        self._events.undeclare()
        for publisher in self._publishers.values():
            publisher.undeclare()

    def _declare_events(self) -> AdvancedPublisher:
        return declare_advanced_publisher(
            self._session,
            wire.key(self._trainer, wire.EVENTS),
            encoding=wire.encoding(wire.Event),
            congestion_control=CongestionControl.DROP,
            priority=Priority.INTERACTIVE_HIGH,
            cache=CacheConfig(max_samples=HISTORY_COUNT),
            publisher_detection=True,
            sample_miss_detection=MissDetectionConfig(
                heartbeat=EVENT_HEARTBEAT_S, sporadic_heartbeat=None
            ),
        )
