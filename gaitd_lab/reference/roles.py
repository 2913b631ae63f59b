"""What each role may do, and the rights that Zenoh checks.

No fact is repeated in this file. The rights are the rows of `daemon/zenoh_io/access.py`. A cell of
the matrix is found by asking both layers: Zenoh's rows whether the message may pass, and for
requests that the core answers `daemon/core/modes/roles.py`, also with the hand switch open and
without a released plan.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gaitd_names import RequestKind, Role

from analysis import markdown
from daemon.core.modes.roles import refusal
from daemon.gateway.requests import ROUTES
from daemon.ipc.record import ModeRequest, Plan, Request
from daemon.zenoh_io.access import RIGHTS, SETPOINTS, Flow, Message, Right
from gaitd_lab.reference.modes import REQUESTS, WELL

NO: Final = "-"
ALL: Final = "all"
ROLES: Final = (*(role for role in Role if role is not Role.UNRESTRICTED), Role.UNRESTRICTED)
PLAN: Final = Plan(cadence_max_hz=1.0, amplitude_max_ratio=1.0, duration_max_s=3600.0)
"""Permits each gait of REQUESTS."""


def parts() -> dict[str, str]:
    """Return the generated parts of docs/security.md by name."""
    return {"roles": _matrix(), "rights": _rights()}


def _matrix() -> str:
    """One row for all actions that the same roles may do on the same conditions."""
    rows: dict[tuple[str, ...], list[str]] = {}
    for action, cells in _actions():
        rows.setdefault(cells, []).append(action)
    head = ("action", *(_word(role) for role in ROLES))
    return markdown.table(head, ((", ".join(names), *cells) for cells, names in rows.items()))


def _actions() -> Iterator[tuple[str, tuple[str, ...]]]:
    yield "subscribe", tuple(_passes(role, Message.SUBSCRIBER, "**") for role in ROLES)
    for name in (name for name in ROUTES if name not in _KINDS):
        yield name, tuple(_passes(role, Message.QUERY, f"control/{name}") for role in ROLES)
    yield "setpoint", tuple(_passes(role, Message.PUT, SETPOINTS[0]) for role in ROLES)
    for action, (kind, wanted) in REQUESTS.items():
        yield action, tuple(_request(role, kind, wanted) for role in ROLES)


_KINDS: Final = frozenset(kind for kind in RequestKind)


def _passes(role: Role, message: Message, key: str) -> str:
    allowed = any(
        role in right.roles and message in right.messages and key in right.keys
        for right in RIGHTS
        if right.flow is Flow.IN
    )
    return "yes" if allowed else NO


def _request(role: Role, kind: RequestKind, wanted: ModeRequest) -> str:
    request = Request(1, kind, mode=wanted, role=role, plan=PLAN)
    passes = _passes(role, Message.QUERY, f"control/{kind}")
    if passes == NO or refusal(request, WELL):
        return NO
    if refusal(request, replace(WELL, hand_switch_closed=False)):
        return "hand switch held"
    without_plan = Request(1, kind, mode=wanted, role=role, plan=None)
    return "within the released plan" if refusal(without_plan, WELL) else "yes"


def _rights() -> str:
    head = ("right", "who", "way", "messages", "keys")
    return markdown.table(head, map(_right, RIGHTS))


def _right(right: Right) -> tuple[str, ...]:
    everyone = right.roles == frozenset(Role)
    return (
        right.name,
        ALL
        if everyone
        else ", ".join(_word(role) for role in sorted(right.roles, key=tuple(Role).index)),
        "in" if right.flow is Flow.IN else "out",
        ", ".join(sorted(message.value for message in right.messages)),
        ", ".join(f"`{key}{'/CLIENT' if right.by_client else ''}`" for key in right.keys),
    )


def _word(role: Role) -> str:
    return role
