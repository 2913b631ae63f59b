"""Access rights of clients on the gateway's Zenoh session, as one table.

Each row of `RIGHTS` allows some messages; what no row allows is denied, and no row lets a message
pass through the gateway from one client to another. Zenoh checks each message of each link against
the table (`access_control` of its configuration) before our code receives it. So no client can
act as gateway or controller for another one: it cannot publish the gateway's messages, answer in
its place, hold its token, or receive setpoints and with them the number of the lease.

Rules:
1. Every client may stop. A new role gets every row for ALL_ROLES.
2. A subscription may have any key expression, because only outgoing messages are restricted. A
   query may not: a wide key expression would be several requests in one.
3. No key of an incoming message matches a key of an outgoing one.
4. Links without a certificate cannot be distinguished: all of them have the role CLIENT.
"""

from enum import Enum
from typing import Any, Final, NamedTuple

from daemon import wire
from daemon.gateway.requests import ROUTES, Route


class Role(Enum):
    """Roles of clients that Zenoh can distinguish."""

    CLIENT = "client"


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


ANY_KEY: Final = "**"
EVERY: Final = (ANY_KEY,)
HISTORY: Final = f"{wire.EVENTS}/@adv/**"
"""Keys on which Zenoh's advanced publisher offers events to late joiners."""
PUBLISHED: Final = (
    *(f"*/{name}" for name in ("estimate", "activity", "friction", "stride")),
    "drives/*/*",
    *(wire.SAFETY, wire.EVENTS, HISTORY, wire.HEALTH),
)
"""Keys that the gateway publishes on."""
SETPOINTS: Final = (f"*/{wire.SETPOINT}",)
ALL_ROLES: Final = frozenset(Role)


def _requests(route: Route) -> tuple[str, ...]:
    return tuple(f"{wire.CONTROL}/{name}" for name, taken in ROUTES.items() if taken is route)


_CONTROL: Final = f"{wire.CONTROL}/*"
RIGHTS: Final = (
    Right("subscribe", ALL_ROLES, Flow.IN, (Message.SUBSCRIBER, Message.TOKEN_SUBSCRIBER), EVERY),
    Right("publish", ALL_ROLES, Flow.OUT, (Message.PUT,), PUBLISHED),
    Right("query liveliness", ALL_ROLES, Flow.IN, (Message.TOKEN_QUERY,), EVERY),
    Right("declare liveliness", ALL_ROLES, Flow.OUT, (Message.TOKEN,), (wire.ALIVE, HISTORY)),
    Right("query history", ALL_ROLES, Flow.IN, (Message.QUERY,), (HISTORY,)),
    Right("stop", ALL_ROLES, Flow.IN, (Message.QUERY,), _requests(Route.STOP)),
    Right("query", ALL_ROLES, Flow.IN, (Message.QUERY,), _requests(Route.GATEWAY)),
    Right("lease", ALL_ROLES, Flow.IN, (Message.QUERY,), _requests(Route.LEASE)),
    Right("request", ALL_ROLES, Flow.IN, (Message.QUERY,), _requests(Route.CORE)),
    Right("declare queryables", ALL_ROLES, Flow.OUT, (Message.QUERYABLE,), (_CONTROL, HISTORY)),
    Right("answer", ALL_ROLES, Flow.OUT, (Message.REPLY,), (_CONTROL, wire.EVENTS)),
    Right("send setpoints", ALL_ROLES, Flow.IN, (Message.PUT,), SETPOINTS),
    Right("receive setpoints", ALL_ROLES, Flow.OUT, (Message.SUBSCRIBER,), SETPOINTS),
)


def access_control(trainer: str) -> dict[str, Any]:
    """The table in the form of Zenoh's configuration."""
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
        # A subject without attributes matches every link.
        "subjects": [{"id": role.value} for role in Role],
        "policies": [
            {
                "rules": [right.name for right in RIGHTS if role in right.roles],
                "subjects": [role.value],
            }
            for role in Role
        ],
    }
