"""Roles of clients: what each may do, as one table.

A client has a name and a password or a certificate, issued by `gaitd keys`; its role is part of the
name (`session.livingroom`). Zenoh checks the name and the keys of every message (`daemon/zenoh_io/
access.py` makes its rules from this table). The core checks the role of every request again, with
the mode, the plan and the hand switch, which no key shows (`daemon/core/modes/roles.py`).

Rules:
1. Every client may stop, subscribe to everything published, and ask for status, configuration and
   schemas.
2. `controller` may hold the lease and send setpoints, and request nothing.
3. `session` runs a training without a therapist in the room: it may enable and disable, hold, play
   a gait within the released plan, and run the daily test. RESET and hand guiding are for the
   person in the machine: they need the hand switch held.
4. `operator` may request every mode, release a plan, write marks, and restart the gateway.
5. `service` prepares the empty machine: signs and references, one axis at a time.
6. Without keys every client is UNRESTRICTED: the service then accepts local clients only.
"""

from collections.abc import Mapping
from enum import Enum
from typing import Final, NamedTuple

from gaitd_names import Mode, RequestKind, Role

IDENTITY: Final = r"(display|controller|session|operator|service)\.[a-z0-9][a-z0-9_-]{0,31}"
"""Pattern of ROLE.NAME."""


class Access(Enum):
    """What a role may do besides the requests to the core."""

    LEASE = "lease"
    """Acquire and release the lease, send setpoints, and report a state to be published."""
    PLAN = "plan"
    """Release the plan that limits a session."""
    MARK = "mark"
    """Write a mark, which is published as an event."""
    RESTART = "restart"
    """Restart the gateway, so that changed keys take effect."""


class RoleRules(NamedTuple):
    """The rights of one role."""

    kinds: frozenset[RequestKind] = frozenset()
    modes: frozenset[Mode] = frozenset()
    access: frozenset[Access] = frozenset()
    within_plan: bool = False
    """A gait is limited by the released plan."""
    hand_switch: bool = False
    """RESET and HAND_GUIDING only while the hand switch is held."""


_EVERY_KIND: Final = frozenset(RequestKind) - {RequestKind.NONE}
_TRAINING: Final = frozenset({Mode.HOLD, Mode.GAIT, Mode.HAND_GUIDING, Mode.SELF_TEST})
_PREPARATION: Final = frozenset({Mode.REFERENCE, Mode.COMMISSION})
_EVERY_MODE: Final = _TRAINING | _PREPARATION | {Mode.TORQUE, Mode.EXCITE}

ROLES: Final[Mapping[Role, RoleRules]] = {
    Role.UNRESTRICTED: RoleRules(_EVERY_KIND, _EVERY_MODE, frozenset(Access)),
    Role.DISPLAY: RoleRules(),
    Role.CONTROLLER: RoleRules(access=frozenset({Access.LEASE})),
    Role.SESSION: RoleRules(_EVERY_KIND, _TRAINING, within_plan=True, hand_switch=True),
    Role.OPERATOR: RoleRules(
        _EVERY_KIND, _EVERY_MODE, access=frozenset({Access.PLAN, Access.MARK, Access.RESTART})
    ),
    Role.SERVICE: RoleRules(
        _EVERY_KIND - {RequestKind.ENABLE}, _PREPARATION, access=frozenset({Access.RESTART})
    ),
}


def role_of(identity: str) -> Role:
    """The role in ROLE.NAME.

    Raises:
        KeyError: no such role.
    """
    return Role[identity.partition(".")[0].upper()]
