"""`AsyncTrainer`: the same for asyncio, with asynchronous iterators and awaited requests."""

import asyncio
import contextlib
import sys
from collections.abc import AsyncGenerator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from gaitd_client import wire
from gaitd_client.clock import Clock
from gaitd_client.credentials import Credentials
from gaitd_client.lease import Law, Lease, OnRefusal
from gaitd_client.stream import Stream
from gaitd_client.trainer import EVENTS_KEPT, STRIDES_KEPT, Trainer
from gaitd_client.wire.names import Mode


class AsyncTrainer:
    """As `Trainer`, with `async with`, `async for` and `await`; arguments and errors are the same.

        async with AsyncTrainer("tcp/127.0.0.1:7447") as trainer:
            async for activity in trainer.activity("right"):
                ...

    A request waits for its answer in a thread; the loop goes on.
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

    async def __aenter__(self) -> Self:
        """Connect; see `Trainer`."""
        await asyncio.to_thread(self.sync.__enter__)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close all streams and the connection."""
        await asyncio.to_thread(self.sync.__exit__, kind, error, traceback)

    @property
    def is_connected(self) -> bool:
        """True once the service has accepted a connection."""
        return self.sync.is_connected

    # --- messages -------------------------------------------------------------------------------

    def estimate(self, leg: str, *, keep: int = 1) -> Stream[wire.Estimate]:
        """The observer's estimate of one leg, every cycle."""
        return self.sync.estimate(leg, keep=keep)

    def activity(self, leg: str, *, keep: int = 1) -> Stream[wire.Activity]:
        """The patient's activity in one leg, every cycle."""
        return self.sync.activity(leg, keep=keep)

    def friction(self, leg: str, *, keep: int = 1) -> Stream[wire.Friction]:
        """Friction of one leg's axes, every cycle."""
        return self.sync.friction(leg, keep=keep)

    def drive(self, name: str, *, keep: int = 1) -> Stream[wire.DriveState]:
        """One drive, LEG/AXIS, ten times a second."""
        return self.sync.drive(name, keep=keep)

    def stride(self, leg: str, *, keep: int = STRIDES_KEPT) -> Stream[wire.Stride]:
        """The figures of one leg's strides, each at its end."""
        return self.sync.stride(leg, keep=keep)

    def safety(self, *, keep: int = 1) -> Stream[wire.Safety]:
        """Mode, verdict and lease, on change and once a second."""
        return self.sync.safety(keep=keep)

    def health(self, *, keep: int = 1) -> Stream[wire.Health]:
        """State of the service itself, once a second."""
        return self.sync.health(keep=keep)

    def events(self, *, history_count: int = 50, keep: int = EVENTS_KEPT) -> Stream[wire.Event]:
        """Events: first those of the past, then each as it happens."""
        return self.sync.events(history_count=history_count, keep=keep)

    # --- requests -------------------------------------------------------------------------------

    async def status(self) -> wire.Status:
        """Return the present state of the machine, and the newest events."""
        return await asyncio.to_thread(self.sync.status)

    async def configuration(self) -> wire.Configuration:
        """Return the configuration of the service."""
        return await asyncio.to_thread(self.sync.configuration)

    async def enable(self) -> wire.Reply:
        """Let the service enable its drives."""
        return await asyncio.to_thread(self.sync.enable)

    async def disable(self) -> wire.Reply:
        """Stop in an orderly way, and switch the drives off."""
        return await asyncio.to_thread(self.sync.disable)

    async def stop(self) -> wire.Reply:
        """Stop now, in any mode; every role may."""
        return await asyncio.to_thread(self.sync.stop)

    async def reset(self) -> wire.Reply:
        """Reset a latched stop once its cause is gone."""
        return await asyncio.to_thread(self.sync.reset)

    async def mode(
        self,
        mode: Mode | str,
        *,
        cadence_hz: float = 0.0,
        amplitude_ratio: float = 0.0,
        duration_s: float = 0.0,
        scenario: str = "",
        axis: str = "",
        witnessed: bool = False,
    ) -> wire.Reply:
        """Go to another mode of the enabled machine."""
        return await asyncio.to_thread(
            self.sync.mode,
            mode,
            cadence_hz=cadence_hz,
            amplitude_ratio=amplitude_ratio,
            duration_s=duration_s,
            scenario=scenario,
            axis=axis,
            witnessed=witnessed,
        )

    async def release_plan(self, limits: wire.PlanLimits) -> wire.Reply:
        """Release the limits within which a session may request a gait."""
        return await asyncio.to_thread(self.sync.release_plan, limits)

    async def withdraw_plan(self) -> wire.Reply:
        """Withdraw the released limits."""
        return await asyncio.to_thread(self.sync.withdraw_plan)

    async def restart_gateway(self) -> wire.Reply:
        """Restart the gateway, so that changed keys take effect."""
        return await asyncio.to_thread(self.sync.restart_gateway)

    # --- assist ---------------------------------------------------------------------------------

    @contextlib.asynccontextmanager
    async def lease(
        self,
        name: str,
        law: Law,
        *,
        legs: Sequence[str] | None = None,
        duration_ms: int | None = None,
        on_refusal: OnRefusal | None = None,
    ) -> AsyncGenerator[Lease]:
        """Hold the lease inside `async with`; the law is called in a thread."""
        lease = self.sync.lease(
            name, law, legs=legs, duration_ms=duration_ms, on_refusal=on_refusal
        )
        await asyncio.to_thread(lease.__enter__)
        try:
            yield lease
        finally:
            await asyncio.to_thread(lease.__exit__, *sys.exc_info())
