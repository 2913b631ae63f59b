"""Who may say what to whom over the gateway's Zenoh session: one table.

`RIGHTS` is read row by row; what no row allows is denied, and what would pass through the gateway
from one client to another has no row at all. Zenoh judges each message of each link by it
(`access_control` of its configuration), before anything of ours sees it. So a client can be
neither gateway nor controller for another one: it cannot publish what the gateway tells, answer in
its place, hold its token, or hear setpoints and with them the number of the lease.

Rules:
1. Everybody may stop. A role that is added gets every row that says EVERYBODY.
2. A subscription is only a question: it may be as wide as it likes. What leaves decides what is
   heard. A query is not: a wide one would be several requests in one.
3. A key that comes in has no pattern in common with a key that leaves.
4. Links without a certificate cannot be told apart: all of them are EVERYBODY.
"""

from enum import Enum
from typing import Any, Final, NamedTuple

from daemon import wire
from daemon.gateway.requests import ROUTES, Route


class Role(Enum):
    """The clients that Zenoh can tell apart."""

    EVERYBODY = "everybody"


class Flow(Enum):
    """Which way, as the gateway sees it; in Zenoh's words."""

    IN = "ingress"
    OUT = "egress"


class Message(Enum):
    """What kind of message, in Zenoh's words. A deletion has no row: no client needs one."""

    PUT = "put"
    SUBSCRIBER = "declare_subscriber"
    QUERY = "query"
    QUERYABLE = "declare_queryable"
    REPLY = "reply"
    TOKEN = "liveliness_token"
    TOKEN_QUERY = "liveliness_query"
    TOKEN_SUBSCRIBER = "declare_liveliness_subscriber"


class Right(NamedTuple):
    """These roles may exchange these messages with the gateway on these keys."""

    name: str
    roles: frozenset[Role]
    flow: Flow
    messages: frozenset[Message]
    keys: tuple[str, ...]
    """Below gaitd/TRAINER/; ANY_KEY is every key there is."""


ANY_KEY: Final = "**"
HISTORY: Final = f"{wire.EVENTS}/@adv/**"
"""Where Zenoh's advanced publisher keeps events for late joiners, and says that it does."""
TOLD: Final = (
    *(f"*/{name}" for name in ("estimate", "activity", "friction", "stride")),
    "drives/*/*",
    *(wire.SAFETY, wire.EVENTS, HISTORY, wire.HEALTH),
)
"""What the gateway publishes."""
SETPOINTS: Final = (f"*/{wire.SETPOINT}",)
EVERYBODY: Final = frozenset(Role)


def _requests(route: Route) -> tuple[str, ...]:
    return tuple(f"{wire.CONTROL}/{name}" for name, taken in ROUTES.items() if taken is route)


def _right(
    name: str, roles: frozenset[Role], flow: Flow, messages: set[Message], *keys: str
) -> Right:
    return Right(name, roles, flow, frozenset(messages), keys)


RIGHTS: Final = (
    _right("listen", EVERYBODY, Flow.IN, {Message.SUBSCRIBER, Message.TOKEN_SUBSCRIBER}, ANY_KEY),
    _right("tell", EVERYBODY, Flow.OUT, {Message.PUT}, *TOLD),
    _right("ask whether alive", EVERYBODY, Flow.IN, {Message.TOKEN_QUERY}, ANY_KEY),
    _right("be alive", EVERYBODY, Flow.OUT, {Message.TOKEN}, wire.ALIVE, HISTORY),
    _right("ask for history", EVERYBODY, Flow.IN, {Message.QUERY}, HISTORY),
    _right("stop", EVERYBODY, Flow.IN, {Message.QUERY}, *_requests(Route.STOP)),
    _right("ask", EVERYBODY, Flow.IN, {Message.QUERY}, *_requests(Route.GATEWAY)),
    _right("lease", EVERYBODY, Flow.IN, {Message.QUERY}, *_requests(Route.LEASE)),
    _right("machine", EVERYBODY, Flow.IN, {Message.QUERY}, *_requests(Route.CORE)),
    _right("offer", EVERYBODY, Flow.OUT, {Message.QUERYABLE}, f"{wire.CONTROL}/*", HISTORY),
    _right("answer", EVERYBODY, Flow.OUT, {Message.REPLY}, f"{wire.CONTROL}/*", wire.EVENTS),
    _right("steer", EVERYBODY, Flow.IN, {Message.PUT}, *SETPOINTS),
    _right("be steered", EVERYBODY, Flow.OUT, {Message.SUBSCRIBER}, *SETPOINTS),
)


def access_control(trainer: str) -> dict[str, Any]:
    """The table in the words of Zenoh's configuration."""
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {
                "id": right.name,
                "permission": "allow",
                "flows": [right.flow.value],
                "messages": sorted(message.value for message in right.messages),
                "key_exprs": [
                    key if key == ANY_KEY else wire.key(trainer, key) for key in right.keys
                ],
            }
            for right in RIGHTS
        ],
        # A subject without attributes is every link.
        "subjects": [{"id": role.value} for role in Role],
        "policies": [
            {
                "rules": [right.name for right in RIGHTS if role in right.roles],
                "subjects": [role.value],
            }
            for role in Role
        ],
    }
