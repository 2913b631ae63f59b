"""Access rights of clients on the gateway's Zenoh session, as one table.

Each row of `RIGHTS` allows some messages; what no row allows is denied, and no row lets a message
pass through the gateway from one client to another. Zenoh checks each message of each link against
the table (`access_control` of its configuration) before our code receives it. So no client can
act as gateway or controller for another one: it cannot publish the gateway's messages, answer in
its place, hold its token, or receive setpoints and with them the number of the lease.

Rules:
1. Every client may stop; with keys also one whose link does not match its entry in the register,
   for example a remote client's password on a local link, which has no other right.
2. A subscription may have any key expression, because only outgoing messages are restricted. A
   query may not: a wide key expression would be several requests in one.
3. No key of an incoming message matches a key of an outgoing one.
4. Without keys (`[zenoh] keys`) links cannot be distinguished: each client is UNRESTRICTED, and
   requests have the key `control/NAME`.
5. With keys only the clients of the register can connect, and a request that acts has the key
   `control/NAME/CLIENT`, which Zenoh allows to that client alone. So the name in the key is
   authenticated: the gateway takes name and role from it. The link of a remote client must show a
   password and a certificate with the same name.
"""

from collections.abc import Sequence
from enum import Enum
from typing import Any, Final, NamedTuple

from gaitd_client import wire
from gaitd_names import RequestKind, Role

from daemon.gateway.requests import ROUTES, Route
from daemon.keys.folder import Client
from daemon.wire.roles import ROLES, Access
from daemon.zenoh_io.endpoints import LOCAL_PROTOCOLS, TLS


class Flow(Enum):
    """Direction of a message, from the gateway's side, in Zenoh's terms."""

    IN = "ingress"
    OUT = "egress"


class Message(Enum):
    """Kind of a message, in Zenoh's terms. Deletions have no row: no client needs them."""

    PUT = "put"
    SUBSCRIBER = "declare_subscriber"
    QUERY = "query"
    QUERYABLE = "declare_queryable"
    REPLY = "reply"
    TOKEN = "liveliness_token"
    TOKEN_QUERY = "liveliness_query"
    TOKEN_SUBSCRIBER = "declare_liveliness_subscriber"


class Right(NamedTuple):
    """Permission for roles to exchange messages with the gateway on some keys."""

    name: str
    roles: frozenset[Role]
    flow: Flow
    messages: tuple[Message, ...]
    keys: tuple[str, ...]
    """Keys below gaitd/TRAINER/; ANY_KEY matches every key."""
    by_client: bool = False
    """With keys of clients, each of these keys ends with /CLIENT."""


ANY_KEY: Final = "**"
EVERY: Final = (ANY_KEY,)
HISTORY: Final = f"{wire.EVENTS}/@adv/**"
"""Keys on which Zenoh's advanced publisher offers events to late joiners."""
PUBLISHED: Final = (
    *(f"*/{name}" for name in ("estimate", "activity", "friction", "stride", wire.CONTROLLER)),
    "drives/*/*",
    *(wire.SAFETY, wire.EVENTS, HISTORY, wire.HEALTH),
)
"""Keys that the gateway publishes on."""
SETPOINTS: Final = (f"*/{wire.SETPOINT}",)
ALL_ROLES: Final = frozenset(Role)
QUERYABLES: Final = (f"{wire.CONTROL}/*", f"{wire.CONTROL}/*/*")


def _requests(route: Route) -> tuple[str, ...]:
    return tuple(f"{wire.CONTROL}/{name}" for name, taken in ROUTES.items() if taken is route)


def _with(access: Access) -> frozenset[Role]:
    return frozenset(role for role, rules in ROLES.items() if access in rules.access)


def _query(name: str, roles: frozenset[Role], *keys: str) -> Right:
    return Right(name, roles, Flow.IN, (Message.QUERY,), keys, by_client=True)


RIGHTS: Final = (
    Right("subscribe", ALL_ROLES, Flow.IN, (Message.SUBSCRIBER, Message.TOKEN_SUBSCRIBER), EVERY),
    Right("publish", ALL_ROLES, Flow.OUT, (Message.PUT,), PUBLISHED),
    Right("query liveliness", ALL_ROLES, Flow.IN, (Message.TOKEN_QUERY,), EVERY),
    Right("declare liveliness", ALL_ROLES, Flow.OUT, (Message.TOKEN,), (wire.ALIVE, HISTORY)),
    Right("query history", ALL_ROLES, Flow.IN, (Message.QUERY,), (HISTORY,)),
    Right("stop", ALL_ROLES, Flow.IN, (Message.QUERY,), _requests(Route.STOP)),
    _query("stop by name", ALL_ROLES, *_requests(Route.STOP)),
    Right("query", ALL_ROLES, Flow.IN, (Message.QUERY,), _requests(Route.GATEWAY)),
    _query("lease", _with(Access.LEASE), *_requests(Route.LEASE), *_requests(Route.REPORT)),
    *(
        _query(
            kind,
            frozenset(role for role, rules in ROLES.items() if kind in rules.kinds),
            f"{wire.CONTROL}/{kind}",
        )
        for kind in RequestKind
        if kind is not RequestKind.NONE
    ),
    _query("plan", _with(Access.PLAN), *_requests(Route.PLAN)),
    _query("mark", _with(Access.MARK), *_requests(Route.MARK)),
    _query("restart", _with(Access.RESTART), *_requests(Route.RESTART)),
    Right("declare queryables", ALL_ROLES, Flow.OUT, (Message.QUERYABLE,), (*QUERYABLES, HISTORY)),
    Right("answer", ALL_ROLES, Flow.OUT, (Message.REPLY,), (*QUERYABLES, wire.EVENTS)),
    Right("send setpoints", _with(Access.LEASE), Flow.IN, (Message.PUT,), SETPOINTS),
    Right("receive setpoints", _with(Access.LEASE), Flow.OUT, (Message.SUBSCRIBER,), SETPOINTS),
)


TO_STOP: Final = frozenset({"stop", "declare queryables", "answer"})
"""Rows that a stop needs."""


def access_control(trainer: str, clients: Sequence[Client] | None) -> dict[str, Any]:
    """The table in the form of Zenoh's configuration.

    Args:
        trainer: TRAINER in the keys.
        clients: those that have keys; None: no keys are configured.
    """
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    who: list[Client | None] = [None, *(clients or ())]
    for client in who:
        name = _subject(client)
        if client is not None:
            rights = [right for right in RIGHTS if client.role in right.roles]
        elif clients is None:
            rights = [right for right in RIGHTS if Role.UNRESTRICTED in right.roles]
        else:
            rights = [right for right in RIGHTS if right.name in TO_STOP]
        own = [(f"{right.name}: {name}", right) for right in rights]
        rules += [_rule(identifier, right, trainer, client) for identifier, right in own]
        policies.append({"rules": [identifier for identifier, _ in own], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": _subject(client), **_attributes(client)} for client in who],
        "policies": policies,
    }


def _subject(client: Client | None) -> str:
    return "any client" if client is None else client.name


def _attributes(client: Client | None) -> dict[str, Any]:
    """A subject without attributes matches every link."""
    if client is None:
        return {}
    if not client.remote:
        return {"usernames": [client.name], "link_protocols": LOCAL_PROTOCOLS}
    return {
        "usernames": [client.name],
        "cert_common_names": [client.name],
        "link_protocols": (TLS,),
    }


def _rule(identifier: str, right: Right, trainer: str, client: Client | None) -> dict[str, Any]:
    end = f"/{client.name}" if right.by_client and client is not None else ""
    keys = [key if key == ANY_KEY else wire.key(trainer, key + end) for key in right.keys]
    return {
        "id": identifier,
        "permission": "allow",
        "flows": [right.flow.value],
        "messages": sorted(message.value for message in right.messages),
        "key_exprs": keys,
    }
