"""`AsyncTrainer`: the same for asyncio, with asynchronous iterators and awaited requests."""

import asyncio
from collections.abc import Callable, Coroutine, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import partial, wraps
from pathlib import Path
from types import TracebackType
from typing import Any, Concatenate, Final, ParamSpec, Self, TypeVar

from gaitd_client import wire
from gaitd_client.clock import Clock
from gaitd_client.credentials import Credentials
from gaitd_client.lease import NS_PER_S, Law, Lease, OnRefusal
from gaitd_client.stream import POLL_S
from gaitd_client.trainer import Trainer

T = TypeVar("T")
Arguments = ParamSpec("Arguments")

STOPS_MAX: Final = 8
"""Requests to stop that wait for their answers at the same time."""


def _shared(
    method: Callable[Concatenate[Trainer, Arguments], T],
) -> Callable[Concatenate["AsyncTrainer", Arguments], T]:
    """Make a method that calls that of `Trainer`."""

    @wraps(method)
    def call(self: "AsyncTrainer", *args: Arguments.args, **kwargs: Arguments.kwargs) -> T:
        return method(self.sync, *args, **kwargs)

    return call


def _awaited(
    method: Callable[Concatenate[Trainer, Arguments], T],
) -> Callable[Concatenate["AsyncTrainer", Arguments], Coroutine[Any, Any, T]]:
    """Make a method that calls that of `Trainer` in a thread, and is awaited."""

    @wraps(method)
    async def call(self: "AsyncTrainer", *args: Arguments.args, **kwargs: Arguments.kwargs) -> T:
        return await asyncio.to_thread(method, self.sync, *args, **kwargs)

    return call


class AsyncTrainer:
    """As `Trainer`, with `async with`, `async for` and `await`; arguments and errors are the same.

    ::

        async with AsyncTrainer("tcp/127.0.0.1:7447") as trainer:
            async for activity in trainer.activity("right"):
                ...

    A request waits for its answer in a thread; the loop goes on. A stop, and entering and leaving,
    have threads of their own, so that they never wait behind other work: the law of a lease is in
    force until it is left. A task that is cancelled while it enters or leaves ends only after that,
    so that no connection and no lease is left behind.
    """

    def __init__(
        self,
        endpoint: str | Sequence[str] | None = None,
        credentials: Credentials | Path | str | None = None,
        *,
        trainer: str | None = None,
        client: str = wire.UNNAMED_CLIENT,
        clock: Clock | None = None,
        keep_trying: bool = False,
    ) -> None:
        """As `Trainer`."""
        self.sync = Trainer(
            endpoint,
            credentials,
            trainer=trainer,
            client=client,
            clock=clock,
            keep_trying=keep_trying,
        )
        """The same trainer without asyncio."""
        self._stops = ThreadPoolExecutor(STOPS_MAX, thread_name_prefix="stop")

    async def __aenter__(self) -> Self:
        """Connect; see `Trainer`."""
        await _enter(self.sync)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close all streams and the connection."""
        await _exit(self.sync, kind, error, traceback)

    @property
    def is_connected(self) -> bool:
        """True once the service has accepted a connection."""
        return self.sync.is_connected

    estimate = _shared(Trainer.estimate)
    activity = _shared(Trainer.activity)
    friction = _shared(Trainer.friction)
    drive = _shared(Trainer.drive)
    stride = _shared(Trainer.stride)
    controller = _shared(Trainer.controller)
    safety = _shared(Trainer.safety)
    health = _shared(Trainer.health)
    events = _shared(Trainer.events)

    status = _awaited(Trainer.status)
    configuration = _awaited(Trainer.configuration)
    enable = _awaited(Trainer.enable)
    disable = _awaited(Trainer.disable)
    reset = _awaited(Trainer.reset)
    mode = _awaited(Trainer.mode)
    release_plan = _awaited(Trainer.release_plan)
    withdraw_plan = _awaited(Trainer.withdraw_plan)
    mark = _awaited(Trainer.mark)
    restart_gateway = _awaited(Trainer.restart_gateway)

    async def stop(self) -> wire.Reply:
        """Stop now, in any mode; every role may."""
        return await asyncio.get_running_loop().run_in_executor(self._stops, self.sync.stop)

    def lease(
        self,
        name: str,
        law: Law,
        *,
        legs: Sequence[str] | None = None,
        duration_ms: int | None = None,
        on_refusal: OnRefusal | None = None,
    ) -> "AsyncLease":
        """Return the lease to be held by `async with`; the law is called in a thread."""
        return AsyncLease(
            self.sync.lease(name, law, legs=legs, duration_ms=duration_ms, on_refusal=on_refusal)
        )


class AsyncLease:
    """As `Lease`, for `async with`; made by `AsyncTrainer.lease`."""

    def __init__(self, lease: Lease) -> None:
        """Hold this lease, which is not yet entered."""
        self.sync = lease
        """The same lease without asyncio."""

    async def __aenter__(self) -> Self:
        """Acquire the lease, and start to answer; see `Lease`."""
        await _enter(self.sync)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the answers and release the lease; raise the law's exception."""
        await _exit(self.sync, kind, error, traceback)

    async def wait(self, duration_s: float | None = None) -> None:
        """As `Lease.wait`; the loop goes on, and the wait can be cancelled."""
        clock = self.sync.clock
        end_ns = None if duration_s is None else clock.now_ns() + round(duration_s * NS_PER_S)
        while end_ns is None or clock.now_ns() < end_ns:
            self.sync.wait(0)  # raises what the law has raised
            await asyncio.sleep(POLL_S)
        self.sync.wait(0)

    @property
    def name(self) -> str:
        """Name of this controller."""
        return self.sync.name

    @property
    def is_held(self) -> bool:
        """True if this controller holds the lease and answers, as far as it knows."""
        return self.sync.is_held

    @property
    def why_not(self) -> str:
        """Why the law is not in force; empty if it is."""
        return self.sync.why_not

    @property
    def answered_count(self) -> int:
        """Setpoints sent."""
        return self.sync.answered_count

    @property
    def refused_count(self) -> Mapping[str, int]:
        """Setpoints of the trainer that were refused, by reason; see `Lease`."""
        return self.sync.refused_count


async def _finished(
    function: Callable[..., T], *arguments: object
) -> tuple["asyncio.Future[T]", asyncio.CancelledError | None]:
    """Call the function in a thread of its own and wait for its end, even if cancelled.

    Returns: the outcome, and the cancellation that came meanwhile.
    """
    thread = ThreadPoolExecutor(1, thread_name_prefix="with")
    future = asyncio.get_running_loop().run_in_executor(thread, partial(function, *arguments))
    thread.shutdown(wait=False)
    cancelled: asyncio.CancelledError | None = None
    while not future.done():
        try:
            await asyncio.wait({future})
        except asyncio.CancelledError as error:
            cancelled = error
    return future, cancelled


async def _enter(manager: AbstractContextManager[object]) -> None:
    """Enter in a thread; a cancellation leaves it again."""
    entering, cancelled = await _finished(manager.__enter__)
    error = entering.exception()
    if cancelled is None:
        entering.result()
        return
    if error is None:
        leaving, _ = await _finished(
            manager.__exit__, type(cancelled), cancelled, cancelled.__traceback__
        )
        error = leaving.exception()
    if error is not None:
        cancelled.add_note(f"{type(error).__name__}: {error}")
    raise cancelled


async def _exit(
    manager: AbstractContextManager[object],
    kind: type[BaseException] | None,
    error: BaseException | None,
    traceback: TracebackType | None,
) -> None:
    """Leave in a thread, also if cancelled meanwhile."""
    leaving, cancelled = await _finished(manager.__exit__, kind, error, traceback)
    leaving.result()
    if cancelled is not None:
        raise cancelled
