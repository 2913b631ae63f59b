"""Clients of the gateway: the role of each query, the released plan, and dates that end soon."""

import contextlib
import datetime
import os
import queue
import stat
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec
from gaitd_client import wire
from gaitd_names import EventCode, Outcome, RefusalCode, Role

from daemon.gateway.events import EventDraft, Kind, Priority
from daemon.gateway.requests import ROUTES, Answer, Route
from daemon.ipc.decoding import Decoder, RefusedError
from daemon.ipc.record import Plan
from daemon.keys.folder import AUTHORITY, GATEWAY, Keys
from daemon.report_messages import refused
from daemon.system.files import remove_file, replace_file
from daemon.wire.roles import ROLES, Access, role_of

PLAN_FILE: Final = "plan.json"
EXPIRES_SOON_DAYS: Final = 30
OPEN: Final = frozenset({Route.STOP, Route.GATEWAY})
"""Queries that need no name."""
ACCESS: Final = {
    Route.LEASE: Access.LEASE,
    Route.REPORT: Access.LEASE,
    Route.PLAN: Access.PLAN,
    Route.MARK: Access.MARK,
    Route.RESTART: Access.RESTART,
}
"""Right that a query needs; the core checks those that it answers."""

_DECODER: Final = Decoder(msgspec.json.Decoder(wire.AskedPlan).decode)


class ClientRefusedError(Exception):
    """A query that acts came without a name of the register, or from a role without the right."""

    def __init__(self, refusal: wire.Refusal) -> None:
        """Keep the refusal, which the client gets."""
        super().__init__(refusal.code)
        self.refusal = refusal


class Clients:
    """The clients that may connect; without keys every client is unrestricted."""

    def __init__(self, keys: Keys | None) -> None:
        """`keys` as they were read at the gateway's start."""
        self._dates: dict[str, str] = {}
        self._names: frozenset[str] | None = None
        if keys is not None:
            register = keys.register
            self._names = frozenset(client.name for client in register.clients)
            self._dates = {one.name: one.expires for one in register.clients if one.expires}
            self._dates[GATEWAY] = register.gateway_expires
            self._dates[AUTHORITY] = register.authority_expires

    def role(self, name: str, client: str) -> Role:
        """The role of a query's client; DISPLAY where the query needs no name.

        Zenoh lets no client use another one's name, and no role send what it may not
        (`zenoh_io/access.py`). A query that reaches the gateway all the same is refused here.

        Args:
            name: NAME of control/NAME.
            client: the name in the query's key; empty if there is none.

        Raises:
            ClientRefusedError: the query acts, and its client is not known or has no right to it.
        """
        if self._names is None:
            return Role.UNRESTRICTED
        route = ROUTES[name]
        if client not in self._names:
            if route in OPEN:
                return Role.DISPLAY
            raise ClientRefusedError(refused(RefusalCode.CLIENT_UNNAMED, request=name))
        role = role_of(client)
        if route in ACCESS and ACCESS[route] not in ROLES[role].access:
            may_not = refused(RefusalCode.ROLE_MAY_NOT, role=role, request=name)
            raise ClientRefusedError(may_not)
        return role

    @property
    def have_keys(self) -> bool:
        """True if clients need keys."""
        return self._names is not None

    def link(self, protocol: str, address: str, certificate: str | None) -> wire.Link:
        """A live link, with the entry of the register that has the name of its certificate."""
        name = certificate if certificate in (self._names or ()) else None
        return wire.Link(protocol=protocol, address=address, certificate=certificate, client=name)

    def expiring(self, utc_ns: int) -> tuple[str, ...]:
        """Names whose certificate has ended, or ends within 30 days."""
        day = datetime.datetime.fromtimestamp(utc_ns / 1e9, datetime.UTC).date()
        last = day + datetime.timedelta(days=EXPIRES_SOON_DAYS)
        return tuple(sorted(name for name, date in self._dates.items() if date <= str(last)))


class PlanStore:
    """The released plan, in a file of the state directory. What cannot be trusted is no plan."""

    def __init__(self, path: Path, submit: Callable[[str, Callable[[], None]], bool]) -> None:
        """Read the file; `submit` runs a job in the thread that waits for the disk."""
        self._path, self._submit = path, submit
        self._lock = threading.Lock()
        self._answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        self.limits: wire.PlanLimits | None = None
        self.trouble = ""
        """Why no plan is released although there is a file; empty otherwise."""
        try:
            self.limits = _DECODER.decode(_own(path))
        except FileNotFoundError:
            pass
        except (OSError, RefusedError) as error:
            self.trouble = f"{path}: {error}"

    @property
    def plan(self) -> Plan | None:
        """The plan as the core checks it."""
        limits = self.limits
        return None if limits is None else msgspec.convert(limits, Plan, from_attributes=True)

    def release(self, ticket: int, limits: wire.PlanLimits | None, client: str) -> EventDraft:
        """Put a plan in force, or withdraw it; `answers` has it when the disk's thread has kept it.

        If that thread's queue is full, the disk is waited for here. That is rare, and a gateway
        that hangs here stops the machine.

        Returns: the event, with who and what.
        """
        self.limits = limits
        if not self._submit("plan", lambda: self._keep(ticket, limits)):
            with contextlib.suppress(OSError):
                self._keep(ticket, limits)
        if limits is None:
            values = {"client": client}
            return EventDraft(Priority.INFO, Kind.NOTE, EventCode.PLAN_WITHDRAWN, values)
        values = {
            "client": client,
            "cadence_max_hz": limits.cadence_max_hz,
            "amplitude_max_ratio": limits.amplitude_max_ratio,
            "duration_max_s": limits.duration_max_s,
            "hip_assist_max": limits.hip.assist_max,
            "slide_assist_max": limits.slide.assist_max,
        }
        return EventDraft(Priority.INFO, Kind.NOTE, EventCode.PLAN_RELEASED, values)

    def answers(self) -> list[Answer]:
        """Answers since the last call; a refusal says what a restart may change."""
        return [self._answers.get_nowait() for _ in range(self._answers.qsize())]

    def _keep(self, ticket: int, limits: wire.PlanLimits | None) -> None:
        """Keep a plan over a restart, unless it was replaced or withdrawn meanwhile.

        The plan of before is removed first: it must not come back, whatever fails after that.

        Raises:
            OSError: the disk is full, or fails; the answer says so, too.
        """
        risk = RefusalCode.PLAN_MAY_RETURN
        try:
            with self._lock:
                if self.limits is limits:
                    remove_file(self._path)
                    risk = RefusalCode.PLAN_MAY_BE_LOST
                    if limits is not None:
                        replace_file(self._path, msgspec.json.encode(limits))
        except OSError as error:
            why = refused(risk, str(error.strerror or error))
            self._answers.put(Answer(ticket, Outcome.DONE, why))
            raise
        self._answers.put(Answer(ticket, Outcome.DONE))


def _own(path: Path) -> bytes:
    """The content of a file that only this user could have written.

    Raises:
        OSError: it cannot be read, or others could have written it.
    """
    file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    try:
        status = os.fstat(file)
        if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise PermissionError("another user could have written it")
        return os.read(file, status.st_size)
    finally:
        os.close(file)
