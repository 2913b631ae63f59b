"""The streams of a client: each is a subscription of one key."""

import contextlib
import threading
from typing import Any, TypeVar

import msgspec
import zenoh
from zenoh.ext import HistoryConfig, RecoveryConfig, declare_advanced_subscriber

from gaitd_client import wire
from gaitd_client.clock import Clock
from gaitd_client.connection import Connection
from gaitd_client.errors import ClientError
from gaitd_client.stream import SILENCE_NS, Stream, Watch

T = TypeVar("T", bound=msgspec.Struct)


class Subscriptions:
    """The open streams, and the watch for silence of the whole trainer."""

    def __init__(self, connection: Connection, clock: Clock) -> None:
        self._connection, self._clock = connection, clock
        self._streams: list[Stream[Any]] = []
        self._pulse: Watch | None = None
        self._pulse_subscriber: object = None
        self._lock = threading.RLock()

    def open(
        self,
        kind: type[T],
        *parts: str,
        keep: int,
        silence_ns: int | None = SILENCE_NS,
        history_count: int = 0,
    ) -> Stream[T]:
        """Return a stream of the key made of `parts`.

        Args:
            kind: type of its messages.
            parts: of the key.
            keep: messages that may wait for the consumer.
            silence_ns: silence of a key with regular messages; None: the trainer's silence.
            history_count: number of messages of the past.

        Raises:
            ClientError: the connection was ended.
        """
        subscriber: Any = None

        def close() -> None:
            with self._lock:
                self._streams.remove(stream)
            self._connection.withdraw(declare)
            if subscriber is not None:
                subscriber.undeclare()

        def take(sample: zenoh.Sample) -> None:
            stream.receive(sample.payload.to_bytes(), str(sample.encoding).partition(";")[2])

        def declare(session: zenoh.Session) -> None:
            nonlocal subscriber
            if not history_count:
                subscriber = session.declare_subscriber(stream.key, take)
                return
            history = HistoryConfig(detect_late_publishers=True, max_samples=history_count)
            recovery = RecoveryConfig(heartbeat=True, periodic_queries=None)
            subscriber = declare_advanced_subscriber(
                session, stream.key, take, history=history, recovery=recovery
            )

        key = wire.key(self._connection.target.trainer, *parts)
        with self._lock:
            if self._connection.is_over.is_set():
                raise ClientError(f"{key}: `with` of the trainer was left; enter it again")
            is_cyclic = silence_ns is not None
            watch = Watch(self._clock, silence_ns) if is_cyclic else self._trainers_watch()
            stream = Stream(key, kind, watch, keep=keep, is_cyclic=is_cyclic, on_close=close)
            self._connection.declare(declare)
            self._streams.append(stream)
        return stream

    def close(self) -> None:
        """Close all streams.

        Raises:
            NotReturnedError: a function that was given to `Stream.call` does not return.
            BaseException: what such a function has raised.
        """
        with self._lock:
            streams, self._pulse = tuple(self._streams), None
        with contextlib.ExitStack() as ending:
            for stream in streams:
                ending.callback(stream.close)

    def _trainers_watch(self) -> Watch:
        """Return the watch that finds silence of the whole trainer."""
        if self._pulse is None:
            self._pulse = pulse = Watch(self._clock)
            key = wire.key(self._connection.target.trainer, "drives", "*", "*")

            def declare(session: zenoh.Session) -> None:
                self._pulse_subscriber = session.declare_subscriber(
                    key, lambda _sample: pulse.beat()
                )

            self._connection.declare(declare)
        return self._pulse
