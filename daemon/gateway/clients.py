"""Clients of the gateway: the role of each query, the released plan, and dates that end soon."""

import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from daemon import wire
from daemon.gateway.events import EventDraft, Kind, Priority
from daemon.gateway.requests import ROUTES, Route
from daemon.ipc.decoding import Decoder, RefusedError
from daemon.ipc.record import Plan, Role
from daemon.keys.folder import GATEWAY, Keys
from daemon.wire.roles import role_of

PLAN_FILE: Final = "plan.json"
EXPIRES_SOON_DAYS: Final = 30
OPEN: Final = frozenset({Route.STOP, Route.GATEWAY})
"""Queries that need no name."""

_DECODER: Final = Decoder(msgspec.json.Decoder(wire.PlanLimits).decode)


class UnnamedClientError(Exception):
    """A query that acts came without the name of a client of the register."""


class Clients:
    """The clients that may connect; without keys every client is unrestricted."""

    def __init__(self, keys: Keys | None) -> None:
        """`keys` as they were read at the gateway's start."""
        self._dates: dict[str, str] = {}
        self._names: frozenset[str] | None = None
        if keys is not None:
            self._names = frozenset(client.name for client in keys.register.clients)
            self._dates = {c.name: c.expires for c in keys.register.clients if c.expires}
            self._dates[GATEWAY] = keys.register.gateway_expires

    def role(self, name: str, client: str) -> Role:
        """The role of a query's client; DISPLAY where the query needs no name.

        Zenoh lets no client use another one's name (`zenoh_io/access.py`). A query that reaches
        the gateway without a name all the same is refused.

        Args:
            name: NAME of control/NAME.
            client: the name in the query's key; empty if there is none.

        Raises:
            UnnamedClientError: the query acts, and its client is not known.
        """
        if self._names is None:
            return Role.UNRESTRICTED
        if client in self._names:
            return role_of(client)
        if ROUTES[name] in OPEN:
            return Role.DISPLAY
        raise UnnamedClientError(
            f"control/{name} needs the client's name in its key: control/{name}/ROLE.NAME"
        )

    @property
    def have_keys(self) -> bool:
        """True if clients need keys."""
        return self._names is not None

    def link(self, protocol: str, address: str, certificate: str | None) -> wire.Link:
        """A live link with the entry that its certificate matched."""
        name = certificate if certificate in (self._names or ()) else None
        return wire.Link(protocol=protocol, address=address, certificate=certificate, client=name)

    def expiring(self, utc_ns: int) -> tuple[str, ...]:
        """Names whose certificate has ended, or ends within 30 days."""
        day = datetime.datetime.fromtimestamp(utc_ns / 1e9, datetime.UTC).date()
        last = day + datetime.timedelta(days=EXPIRES_SOON_DAYS)
        return tuple(sorted(name for name, date in self._dates.items() if date <= str(last)))


class PlanStore:
    """The released plan, in a file of the state directory. What cannot be read is no plan."""

    def __init__(self, path: Path, submit: Callable[[str, Callable[[], None]], bool]) -> None:
        """Read the file; `submit` runs a job in the thread that waits for the disk."""
        self._path, self._submit = path, submit
        self.limits: wire.PlanLimits | None = None
        self.trouble = ""
        """Why the file could not be read; empty if it could, or if there is none."""
        try:
            self.limits = _DECODER.decode(path.read_bytes())
        except FileNotFoundError:
            pass
        except (OSError, RefusedError) as error:
            self.trouble = f"{path}: no plan is released: {error}"

    @property
    def plan(self) -> Plan | None:
        """The plan as the core checks it."""
        limits = self.limits
        if limits is None:
            return None
        return Plan(limits.cadence_max_hz, limits.amplitude_max_ratio, limits.duration_max_s)

    def release(self, limits: wire.PlanLimits | None, client: str) -> EventDraft:
        """Put a plan in force, or withdraw it, and keep it over a restart."""
        self.limits = limits
        self._submit("plan", lambda: self._write(limits))
        if limits is None:
            return EventDraft(Priority.INFO, Kind.NOTE, f"the plan is withdrawn by {client}")
        text = (
            f"plan released by {client}: up to {limits.cadence_max_hz:g} Hz,"
            f" amplitude {limits.amplitude_max_ratio:g}, {limits.duration_max_s:g} s"
        )
        return EventDraft(Priority.INFO, Kind.NOTE, text)

    def _write(self, limits: wire.PlanLimits | None) -> None:
        if limits is None:
            self._path.unlink(missing_ok=True)
            return
        new = self._path.with_suffix(".new")
        new.write_bytes(msgspec.json.encode(limits))
        new.replace(self._path)
