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

from collections.abc import Iterator, Sequence

from gaitd_names import EventCode
from msgspec.structs import replace

from daemon.core.slices import Inputs
from daemon.ipc.record import GatewayState
from daemon.ipc.report import Event
from daemon.wire.roles import ROLES, Access


def receive(
    before: Inputs,
    gateway_states: Sequence[GatewayState],
    boot_id: str,
    request_id: int,
    cycle: int,
) -> Inputs:
    """Read all waiting gateway states.

    Args:
        before: what was received up to the cycle before.
        gateway_states: those that have come since, oldest first.
        boot_id: of this core.
        request_id: of the newest request that this core has received.
        cycle: the number of this cycle.
    """
    stop = False
    stop_count, seq = before.stop_count, before.gateway_state_seq
    newest: GatewayState | None = None
    for gateway_state in gateway_states:
        # The first gateway state only initialises the count: nothing is moving yet.
        more = stop_count is None or gateway_state.stop_count > stop_count
        stop = stop or (more and stop_count is not None)
        newer = (
            gateway_state.core_boot_id == boot_id
            and gateway_state.seq > seq
            and gateway_state.for_cycle <= cycle
        )
        if more or newer:
            stop_count = gateway_state.stop_count
        if newer:
            seq, newest = gateway_state.seq, gateway_state
    if newest is None:
        return replace(before, stop=stop, request=None, stop_count=stop_count)
    may_hold = Access.LEASE in ROLES[newest.lease_role].access
    return Inputs(
        stop=stop,
        request=newest.request if newest.request.id > request_id else None,
        stop_count=stop_count,
        gateway_state_seq=seq,
        gateway_state_cycle=max(before.gateway_state_cycle, newest.for_cycle),
        setpoints=newest.setpoints,
        lease=newest.lease if may_hold else 0,
        lease_dropped=0 if may_hold else newest.lease,
        lease_role=newest.lease_role,
    )


def news(before: Inputs, after: Inputs) -> Iterator[Event]:
    """A lease whose holder has no right to it."""
    if after.lease_dropped not in {0, before.lease_dropped}:
        yield Event(EventCode.LEASE_DROPPED, values=(after.lease_role,))
