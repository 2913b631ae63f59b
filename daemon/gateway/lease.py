"""The lease: permission for one client to command torque, for a limited time, proven by a number.

    acquire     no lease is held            granted, with a new number
                the holder, by its number   renewed, with the same number
                any other client            refused, with the holder's name
    release     the holder, by its number   ended
    accepted setpoint                       renewed
    time over, a stop, another core,
    a machine that is stopped               ended

A lease is renewed by setpoints that the core reports as accepted, not by those that the gateway
forwarded. The number is random and cannot be guessed. It is sent only to the holder and to the
core; it is never published, logged or recorded. The time is an argument: this module reads no
clock and does not use Zenoh.
"""

import secrets
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum, auto
from typing import Final, NamedTuple

from gaitd_client import wire
from gaitd_names import RefusalCode

from daemon.config.settings import Lease as LeaseRules
from daemon.report_messages import refused

NUMBER_BITS: Final = 53
"""Bits of a lease number: integers up to 2**53 are exact in every JSON reader."""
REMEMBERED_COUNT: Final = 10_000
"""Number of past lease numbers that are not used again."""
NS_PER_MS: Final = 1_000_000


class Granted(NamedTuple):
    """A granted lease, as it is sent to its holder."""

    number: int
    duration_ms: int
    renewed: bool


class LeaseEnd(StrEnum):
    """Why a lease has ended: `lease_end` of the event."""

    RELEASED = auto()
    CORE_RESTARTED = auto()
    MACHINE_STOPPED = auto()
    STOP_REQUESTED = auto()
    EXPIRED = auto()


class Ended(NamedTuple):
    """A lease that has ended, and why."""

    client: str
    why: LeaseEnd


class LeaseRefusedError(Exception):
    """The request for the lease is refused."""

    def __init__(self, refusal: wire.Refusal) -> None:
        """Keep the refusal, which the client gets."""
        super().__init__(refusal.code)
        self.refusal = refusal


@dataclass(slots=True)
class _Held:
    client: str
    number: int
    duration_ms: int
    expires_ns: int


def draw_number() -> int:
    """A random lease number that cannot be guessed; never 0."""
    return secrets.randbits(NUMBER_BITS) or 1


@dataclass(slots=True)
class LeaseManager:
    """Grants, renews and ends the lease."""

    rules: LeaseRules
    draw: Callable[[], int] = draw_number
    _held: _Held | None = None
    _given: deque[int] = field(default_factory=lambda: deque(maxlen=REMEMBERED_COUNT))

    @property
    def number(self) -> int:
        """Number of the lease that is held; 0: none."""
        return self._held.number if self._held else 0

    @property
    def holder(self) -> str | None:
        """Name of the client that holds the lease; None if no lease is held."""
        return self._held.client if self._held else None

    def acquire(
        self, client: str, number: int | None, wanted_ms: int | None, now_ns: int
    ) -> Granted:
        """Grant the lease, or renew it for the client that sends its number.

        Args:
            client: name of the client, for events and the log.
            number: of the lease that the client holds already; None: it requests a new one.
            wanted_ms: duration of the lease without renewal; None: as configured.
            now_ns: the time.

        Raises:
            LeaseRefusedError: another client holds the lease, or the number is not the lease's.
        """
        held = self._held
        if held is None and number is not None:
            raise LeaseRefusedError(refused(RefusalCode.LEASE_OVER))
        if held is not None and (number != held.number or client != held.client):
            raise LeaseRefusedError(_not_of(held, client))
        duration_ms = min(wanted_ms or self.rules.duration_ms, self.rules.duration_max_ms)
        renewed = held is not None
        number = held.number if held is not None else self._new_number()
        self._held = _Held(client, number, duration_ms, now_ns + duration_ms * NS_PER_MS)
        return Granted(number, duration_ms, renewed)

    def release(self, client: str, number: int) -> Ended:
        """End the lease at its holder's request.

        Raises:
            LeaseRefusedError: no lease is held, or not by this client with this number.
        """
        self.check_holder(client, number)
        self._held = None
        return Ended(client, LeaseEnd.RELEASED)

    def check_holder(self, client: str, number: int) -> None:
        """Check that this client holds the lease.

        Raises:
            LeaseRefusedError: no lease is held, or not by this client with this number.
        """
        held = self._held
        if held is None:
            raise LeaseRefusedError(refused(RefusalCode.LEASE_NOT_HELD))
        if number != held.number or client != held.client:
            raise LeaseRefusedError(_not_of(held, client))

    def renew(self, now_ns: int) -> None:
        """Renew the lease after an accepted setpoint."""
        if self._held is not None:
            self._held.expires_ns = now_ns + self._held.duration_ms * NS_PER_MS

    def end(self, why: LeaseEnd) -> Ended | None:
        """End the lease, if one is held, without the holder's request."""
        held, self._held = self._held, None
        return Ended(held.client, why) if held else None

    def tick(self, now_ns: int) -> Ended | None:
        """End the lease if its time is over."""
        if self._held is None or now_ns < self._held.expires_ns:
            return None
        return self.end(LeaseEnd.EXPIRED)

    def _new_number(self) -> int:
        number = self.draw()
        while number in self._given:
            number = self.draw()
        self._given.append(number)
        return number


def _not_of(held: _Held, client: str) -> wire.Refusal:
    """Why a client that does not prove the lease by its number is refused."""
    is_name = client == held.client
    code = RefusalCode.LEASE_NUMBER_WRONG if is_name else RefusalCode.LEASE_TAKEN
    return refused(code, holder=held.client)
