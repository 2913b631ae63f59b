"""Gateway states received in a cycle are reduced to a stop, a request and setpoints.

Rules:
1. Every received gateway state can stop: a stop count above the known one is a stop.
2. All other fields are used only from a gateway state that is addressed to this core
   (`core_boot_id`), has a higher `seq` than all before, and refers to a cycle that has started.
   A datagram that is received twice therefore has no effect the second time.
3. The age of a gateway state is counted from the cycle it refers to, not from its arrival.
4. A request is new if its id is higher than the id of every earlier request.
5. The known stop count is also lowered by a newer gateway state, so that the next stop of a
   gateway that counts lower has an effect. An older gateway state, or one for another core, can
   only raise it.
6. A lease counts only if the role of its holder may have one. A gateway of an older version sends
   no role: its lease is dropped, its setpoints are refused as UNLEASED, and an event says so once.
"""

from collections.abc import Sequence
from typing import NamedTuple

from gaitd_names import EventCode

from daemon.core.state import Core
from daemon.ipc.record import GatewayState, Request
from daemon.wire.roles import ROLES, Access


class CommandInputs(NamedTuple):
    """The stop and the new request that this cycle received."""

    stop: bool = False
    request: Request | None = None
    """New in this cycle and not checked yet."""


NO_INPUTS = CommandInputs()


def receive(core: Core, gateway_states: Sequence[GatewayState], cycle: int) -> CommandInputs:
    """Read all waiting gateway states, oldest first, and update the core's command inputs."""
    stop = False
    newest: GatewayState | None = None
    for gateway_state in gateway_states:
        # The first gateway state only initialises the count: nothing is moving yet.
        known = core.stop_count
        more = known is None or gateway_state.stop_count > known
        stop = stop or (more and known is not None)
        newer = (
            gateway_state.core_boot_id == core.boot_id
            and gateway_state.seq > core.gateway_state_seq
            and gateway_state.for_cycle <= cycle
        )
        if more or newer:
            core.stop_count = gateway_state.stop_count
        if newer:
            core.gateway_state_seq, newest = gateway_state.seq, gateway_state
    if newest is None:
        return CommandInputs(stop)
    core.gateway_state_cycle = max(core.gateway_state_cycle, newest.for_cycle)
    core.setpoints = newest.setpoints
    _receive_lease(core, newest)
    return CommandInputs(stop, newest.request if _is_new(core, newest.request) else None)


def _receive_lease(core: Core, newest: GatewayState) -> None:
    may_hold = Access.LEASE in ROLES[newest.lease_role].access
    core.lease, dropped = (newest.lease, 0) if may_hold else (0, newest.lease)
    if dropped and dropped != core.lease_dropped:
        core.report(EventCode.LEASE_DROPPED, "", newest.lease_role)
    core.lease_dropped = dropped


def _is_new(core: Core, request: Request) -> bool:
    return request.id > core.result.id
