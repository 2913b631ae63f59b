"""Messages of one key as a stream: an iterator, an asynchronous iterator, calls of a function.

A stream yields messages, and `NotValid` where there is no message that may be used. So a value of
the past is never taken for one of the present:

1. After 200 ms of silence, by the trainer's clock, a stream yields `NotValid` once; `newest`
   returns it until the next message. Keys with fewer messages (safety, health, events, stride) are
   silent if the trainer is: `drives/*/*` has ten messages a second.
2. With `keep=1` a slow consumer gets the newest message only. `dropped_count` counts the others.
3. A payload that cannot be decoded is a `NotValid`, too, and the stream goes on.
"""

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from types import TracebackType
from typing import Final, Generic, NamedTuple, Self, TypeVar

import msgspec

from gaitd_client import wire
from gaitd_client.clock import Clock

T = TypeVar("T", bound=msgspec.Struct)

SILENCE_NS: Final = 200_000_000
"""Nothing is valid after this time without a message."""
POLL_S: Final = 0.02
"""Time of the computer between two looks at the clock while no message arrives."""


class Trouble(Enum):
    """Why there is no message."""

    SILENT = "silent"
    """No message for 200 ms: the service, the core or the connection is away."""
    UNREADABLE = "unreadable"
    """A payload that is not the JSON of this message."""


@dataclass(frozen=True, slots=True)
class NotValid:
    """Instead of a message: nothing about this key is known at present."""

    key: str
    trouble: Trouble
    text: str


class Watch:
    """Finds silence: of one key with a message in each cycle, or of the whole trainer."""

    def __init__(self, clock: Clock) -> None:
        """Start; without any message there is silence 200 ms later."""
        self._clock = clock
        self._newest_ns = clock.now_ns()
        self.gap_count = 0
        """Silences that have ended; messages before one are of the past."""

    def beat(self) -> None:
        """Take note of a message."""
        now_ns = self._clock.now_ns()
        if now_ns - self._newest_ns > SILENCE_NS:
            self.gap_count += 1
        self._newest_ns = now_ns

    @property
    def is_silent(self) -> bool:
        """True if the last message is too old."""
        return self._clock.now_ns() - self._newest_ns > SILENCE_NS


class _Received(NamedTuple):
    gap_count: int
    payload: bytes
    schema: str


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
        self.key = key
        self.dropped_count = 0
        """Messages that were replaced by newer ones before they were consumed."""
        self.unreadable_count = 0
        """Payloads that were consumed and could not be decoded."""
        self._watch, self._is_cyclic, self._on_close = watch, is_cyclic, on_close
        self._schema = wire.schema_name(kind)
        self._decoder = msgspec.json.Decoder(kind)
        self._waiting: deque[_Received] = deque(maxlen=keep)
        self._last: _Received | None = None
        self._told_silence = self._is_closed = False
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
        """End all iterators and calls, and the subscription."""
        with self._changed:
            is_first, self._is_closed = not self._is_closed, True
            self._wake()
        if is_first:
            self._on_close()
        if self._calls is not None and self._calls is not threading.current_thread():
            self._calls.join()

    def _wake(self) -> None:
        self._changed.notify_all()
        for waker in self._wakers:
            waker()

    # --- messages out ---------------------------------------------------------------------------

    def newest(self) -> T | NotValid:
        """Return the newest message, without waiting; `NotValid` if it is of the past."""
        with self._changed:
            last = self._last
            if last is None or self._watch.is_silent or last.gap_count != self._watch.gap_count:
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
            yield self._decode(taken) if isinstance(taken, _Received) else taken

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
                        await asyncio.wait_for(changed.wait(), POLL_S)
                else:
                    yield self._decode(taken) if isinstance(taken, _Received) else taken
        finally:
            with self._changed:
                self._wakers.remove(waker)

    def call(self, function: Callable[[T | NotValid], object]) -> None:
        """Call the function with each message or silence, in a thread of this stream.

        An exception of the function is printed with its traceback, and ends the calls.
        """
        self._calls = threading.Thread(target=self._call, args=(function,), name=self.key)
        self._calls.daemon = True
        self._calls.start()

    def _call(self, function: Callable[[T | NotValid], object]) -> None:
        for item in self:
            function(item)

    def _take(self) -> _Received | NotValid | None:
        """Return what comes next; None: nothing yet."""
        is_silent = self._watch.is_silent
        if is_silent and self._waiting.maxlen == 1:
            self.dropped_count += len(self._waiting)
            self._waiting.clear()
        if self._waiting:
            self._told_silence = False
            return self._waiting.popleft()
        if is_silent and not self._told_silence:
            self._told_silence = True
            return self._silence()
        self._told_silence = is_silent
        return None

    def _silence(self) -> NotValid:
        return NotValid(self.key, Trouble.SILENT, "no message for 200 ms: nothing is known")

    def _decode(self, received: _Received) -> T | NotValid:
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
