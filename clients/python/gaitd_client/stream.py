"""Messages of one key as a stream: an iterator, an asynchronous iterator, calls of a function.

A stream yields messages, and `NotValid` where there is no message that may be used. So a value of
the past is never taken for one of the present:

1. After 200 ms of silence, by the trainer's clock, a stream yields `NotValid` once; `newest`
   returns it until the next message. For safety and health, which come once a second, it is 1.5 s.
   Events and strides are silent if the trainer is: `drives/*/*` has ten messages a second.
2. With `keep=1` a slow consumer gets the newest message only. `dropped_count` counts the others.
3. A payload that cannot be decoded is a `NotValid`, too, and the stream goes on.
4. After an exception of a function of `call` there is only `NotValid`.
"""

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from types import TracebackType
from typing import Final, Generic, Self, TypeVar

import msgspec

from gaitd_client import wire
from gaitd_client.clock import Clock
from gaitd_client.errors import NotReturnedError

T = TypeVar("T", bound=msgspec.Struct)

SILENCE_NS: Final = 200_000_000
"""Nothing is valid after this time without a message."""
SECOND_SILENCE_NS: Final = 1_500_000_000
"""Nothing of a key with one message a second is valid after this time without one."""
JOIN_S: Final = 3.0
"""Longest wait for a function of `call` at the end: longer than it takes to acquire a lease."""
POLL_S: Final = 0.02
"""Time of the computer between two looks at the clock while no message arrives."""


class Trouble(Enum):
    """Why there is no message."""

    SILENT = "silent"
    """No message for too long: the service, the core or the connection is away."""
    UNREADABLE = "unreadable"
    """A payload that is not the JSON of this message."""
    FAILED = "failed"
    """The function of `call` has raised; nothing is consumed any more."""


@dataclass(frozen=True, slots=True)
class NotValid:
    """Instead of a message: nothing about this key is known at present."""

    key: str
    trouble: Trouble
    text: str


class Watch:
    """Finds silence: of one key with a message in each cycle, or of the whole trainer."""

    def __init__(self, clock: Clock, silence_ns: int = SILENCE_NS) -> None:
        """Start; without any message there is silence `silence_ns` later."""
        self._clock, self.silence_ns = clock, silence_ns
        self._newest_ns = clock.now_ns()
        self.gap_count = 0
        """Silences that have ended; messages before one are of the past."""

    def beat(self) -> None:
        """Take note of a message."""
        now_ns = self._clock.now_ns()
        if now_ns - self._newest_ns > self.silence_ns:
            self.gap_count += 1
        self._newest_ns = now_ns

    @property
    def is_silent(self) -> bool:
        """True if the last message is too old."""
        return self._clock.now_ns() - self._newest_ns > self.silence_ns


@dataclass(slots=True)
class _Received(Generic[T]):
    gap_count: int
    payload: bytes
    schema: str
    item: T | NotValid | None = None
    """None until it is decoded."""


class Stream(Generic[T]):
    """Messages of one key; `Trainer` makes it, and closes it at its end.

    Use one consumer of a stream at a time: a loop, an asynchronous loop, or `call`.
    """

    def __init__(
        self,
        key: str,
        kind: type[T],
        watch: Watch,
        *,
        keep: int = 1,
        is_cyclic: bool = True,
        on_close: Callable[[], object] = lambda: None,
    ) -> None:
        """Start without a message.

        Args:
            key: Zenoh key.
            kind: type of its messages.
            watch: finds the silence of this key.
            keep: messages that may wait for the consumer; 1: the newest only.
            is_cyclic: each message counts for `watch`; false: `watch` is the trainer's.
            on_close: called once, when the stream is closed.

        Raises:
            ValueError: `keep` is less than 1.
        """
        if keep < 1:
            raise ValueError(f"keep = {keep} for {key}: at least 1 message must be kept")
        self.key, self.kind = key, kind
        self.dropped_count = 0
        """Messages that were replaced by newer ones before they were consumed."""
        self.unreadable_count = 0
        """Payloads that could not be decoded, of those that were consumed or read by `newest`."""
        self._watch, self._is_cyclic, self._on_close = watch, is_cyclic, on_close
        self._schema = wire.schema_name(kind)
        self._decoder = msgspec.json.Decoder(kind)
        self._waiting: deque[_Received[T]] = deque(maxlen=keep)
        self._last: _Received[T] | None = None
        self._told_silence = self._told_error = self._is_closed = False
        self._error: BaseException | None = None
        """Exception of the function of `call`."""
        self._changed = threading.Condition()
        self._wakers: list[Callable[[], object]] = []
        self._calls: threading.Thread | None = None

    # --- messages in ----------------------------------------------------------------------------

    def receive(self, payload: bytes, schema: str = "") -> None:
        """Take a payload; called in a thread of Zenoh.

        Args:
            payload: JSON.
            schema: `gaitd.NAME.vN` of its encoding; empty: unknown.
        """
        with self._changed:
            if self._is_cyclic:
                self._watch.beat()
            self.dropped_count += len(self._waiting) == self._waiting.maxlen
            self._last = _Received(self._watch.gap_count, payload, schema)
            self._waiting.append(self._last)
            self._wake()

    def close(self) -> None:
        """End all iterators and calls, and the subscription.

        Raises:
            NotReturnedError: the function of `call` has not returned after 3 s.
            BaseException: what the function of `call` has raised.
        """
        with self._changed:
            is_first, self._is_closed = not self._is_closed, True
            self._wake()
        if is_first:
            self._on_close()
        calls = self._calls
        if calls is None or calls is threading.current_thread():
            return
        calls.join(JOIN_S)
        if calls.is_alive():
            self._calls = None
            raise NotReturnedError(
                f"{self.key}: a call has not returned {JOIN_S:g} s after the end"
            )
        if self._error is not None:
            raise self._error

    def _wake(self) -> None:
        self._changed.notify_all()
        for waker in tuple(self._wakers):
            try:
                waker()
            except RuntimeError:  # its event loop was closed, and the iterator with it
                self._wakers.remove(waker)

    # --- messages out ---------------------------------------------------------------------------

    def newest(self) -> T | NotValid:
        """Return the newest message, without waiting; `NotValid` if it is of the past."""
        with self._changed:
            if self._error is not None:
                return self._failure(self._error)
            last = self._last
            if last is None or self._is_past:
                return self._silence()
            return self._decode(last)

    def __iter__(self) -> Iterator[T | NotValid]:
        """Wait for each message or silence, until the stream is closed."""
        while True:
            with self._changed:
                while (taken := self._take()) is None:
                    if self._is_closed:
                        return
                    self._changed.wait(POLL_S)
            yield taken

    async def __aiter__(self) -> AsyncIterator[T | NotValid]:
        """As the iterator, for asyncio."""
        loop, changed = asyncio.get_running_loop(), asyncio.Event()

        def waker() -> None:
            loop.call_soon_threadsafe(changed.set)

        with self._changed:
            self._wakers.append(waker)
        try:
            while True:
                changed.clear()
                with self._changed:
                    taken = self._take()
                    if taken is None and self._is_closed:
                        return
                if taken is None:
                    with contextlib.suppress(TimeoutError):
                        # On Python 3.11 `wait_for` can swallow a cancellation.
                        async with asyncio.timeout(POLL_S):
                            await changed.wait()
                else:
                    yield taken
        finally:
            with self._changed:
                if waker in self._wakers:
                    self._wakers.remove(waker)

    def call(self, function: Callable[[T | NotValid], object]) -> None:
        """Call the function with each message or silence, in a thread of this stream.

        An exception of the function is printed with its traceback, and ends the calls. From then on
        the stream yields `NotValid`, and `close` and the end of the trainer's `with` raise it.
        """
        self._calls = threading.Thread(target=self._call, args=(function,), name=self.key)
        self._calls.daemon = True
        self._calls.start()

    def _call(self, function: Callable[[T | NotValid], object]) -> None:
        try:
            for item in self:
                function(item)
        except BaseException as error:
            with self._changed:
                self._error = error
                self._wake()
            raise

    def _take(self) -> T | NotValid | None:
        """Return what comes next; None: nothing yet."""
        if self._error is not None:
            was_told, self._told_error = self._told_error, True
            return None if was_told else self._failure(self._error)
        is_past = self._is_past
        if is_past and self._waiting.maxlen == 1:
            self.dropped_count += len(self._waiting)
            self._waiting.clear()
        if self._waiting:
            self._told_silence = False
            return self._decode(self._waiting.popleft())
        if is_past and not self._told_silence:
            self._told_silence = True
            return self._silence()
        self._told_silence = is_past
        return None

    @property
    def _is_past(self) -> bool:
        """True during a silence, and after it until the next message."""
        last, watch = self._last, self._watch
        return watch.is_silent or (last is not None and last.gap_count != watch.gap_count)

    def _silence(self) -> NotValid:
        silence_ms = self._watch.silence_ns // 1_000_000
        text = f"no message on {self.key} for {silence_ms} ms: nothing is known"
        return NotValid(self.key, Trouble.SILENT, text)

    def _failure(self, error: BaseException) -> NotValid:
        text = f"the function of `call` on {self.key} has raised {type(error).__name__}: {error}"
        return NotValid(self.key, Trouble.FAILED, text)

    def _decode(self, received: _Received[T]) -> T | NotValid:
        if received.item is None:
            received.item = self._decoded(received)
        return received.item

    def _decoded(self, received: _Received[T]) -> T | NotValid:
        if received.schema not in {"", self._schema}:
            return self._unreadable(f"is {received.schema}, this client reads {self._schema}")
        try:
            return self._decoder.decode(received.payload)
        except (ValueError, RecursionError) as error:
            return self._unreadable(f"is no {self._schema}: {error}")

    def _unreadable(self, text: str) -> NotValid:
        self.unreadable_count += 1
        return NotValid(self.key, Trouble.UNREADABLE, f"the payload {text}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
