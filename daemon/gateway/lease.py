"""The lease: who may command torque. One holder, for a limited time, by a number nobody can guess.

    acquire     nobody holds it             granted, with a new number
                the holder, by its number   renewed, with the same number
                anybody else                refused, and told who holds it
    release     the holder, by its number   ended
    accepted setpoint                       renewed
    time over, a stop, another core,
    a machine that is stopped               ended

Renewal follows what the core says that it accepted, not what the gateway forwarded. The number goes
to its holder and to the core; it is never published, logged or recorded. Told the time; knows no
clock and no Zenoh.
"""

import secrets
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from daemon.config.settings import Lease as LeaseRules

NUMBER_BITS: Final = 53
"""As far as every JSON reader counts exactly."""
REMEMBERED_COUNT: Final = 10_000
"""Numbers that are not given again; by chance none would be."""
NS_PER_MS: Final = 1_000_000


class Granted(NamedTuple):
    """A lease as its holder is told of it."""

    number: int
    duration_ms: int
    renewed: bool


class Ended(NamedTuple):
    """A lease that is over."""

    client: str
    why: str


class LeaseRefusedError(Exception):
    """Nothing was given or taken: says why, in words for the one who asked."""


@dataclass(slots=True)
class _Held:
    client: str
    number: int
    duration_ms: int
    expires_ns: int


def draw_number() -> int:
    """A number that nobody can guess; never 0."""
    return secrets.randbits(NUMBER_BITS) or 1


@dataclass(slots=True)
class LeaseDesk:
    """Gives the lease, renews it, and takes it back."""

    rules: LeaseRules
    draw: Callable[[], int] = draw_number
    _held: _Held | None = None
    _given: deque[int] = field(default_factory=lambda: deque(maxlen=REMEMBERED_COUNT))

    @property
    def number(self) -> int:
        """Of the lease that is held; 0: none."""
        return self._held.number if self._held else 0

    @property
    def holder(self) -> str | None:
        """Who holds it."""
        return self._held.client if self._held else None

    def acquire(
        self, client: str, number: int | None, wanted_ms: int | None, now_ns: int
    ) -> Granted:
        """Give the lease, or renew it for who shows its number.

        Args:
            client: who asks, for people.
            number: of the lease that the client holds already; None: it asks for a new one.
            wanted_ms: how long the lease is to live without renewal; None: as configured.
            now_ns: the time.

        Raises:
            LeaseRefusedError: somebody else holds it, or the number is none that is held.
        """
        held = self._held
        if held is None and number is not None:
            raise LeaseRefusedError("that lease has ended; acquire a new one, without a number")
        if held is not None and (number != held.number or client != held.client):
            raise LeaseRefusedError(f"{held.client!r} holds the lease")
        duration_ms = min(wanted_ms or self.rules.duration_ms, self.rules.duration_max_ms)
        renewed = held is not None
        number = held.number if held is not None else self._new_number()
        self._held = _Held(client, number, duration_ms, now_ns + duration_ms * NS_PER_MS)
        return Granted(number, duration_ms, renewed)

    def release(self, client: str, number: int) -> Ended:
        """Take the lease back from its holder.

        Raises:
            LeaseRefusedError: nobody holds one, or not this client by this number.
        """
        held = self._held
        if held is None:
            raise LeaseRefusedError("nobody holds the lease")
        if number != held.number or client != held.client:
            raise LeaseRefusedError(f"{held.client!r} holds the lease, by another number")
        self._held = None
        return Ended(held.client, "released")

    def renew(self, now_ns: int) -> None:
        """A setpoint was accepted: the lease lives on."""
        if self._held is not None:
            self._held.expires_ns = now_ns + self._held.duration_ms * NS_PER_MS

    def end(self, why: str) -> Ended | None:
        """Whatever the holder thinks of it."""
        held, self._held = self._held, None
        return Ended(held.client, why) if held else None

    def tick(self, now_ns: int) -> Ended | None:
        """End it when its time is over."""
        if self._held is None or now_ns < self._held.expires_ns:
            return None
        return self.end(f"no setpoint was accepted for {self._held.duration_ms} ms")

    def _new_number(self) -> int:
        number = self.draw()
        while number in self._given:
            number = self.draw()
        self._given.append(number)
        return number
