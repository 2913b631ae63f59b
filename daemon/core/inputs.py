"""What the gateway asks for: read from all waiting levels, the stop counts first of all.

Rules:
1. A stop counts from anybody: any level that says a higher count than is known stops.
2. The rest counts from a level of this core's own gateway that is newer than all before, by `seq`,
   and answers a cycle that has been. So a datagram that arrives again asks for nothing again.
3. A level's age counts from the cycle that it answers, not from its arrival.
4. A request is new if its id is higher than that of every request before.
5. What is known of the count follows a newer level down, too: a gateway that counts lower stops
   with its next one. An older level, or that of another core, only ever raises it.
"""

from collections.abc import Sequence
from typing import NamedTuple

from daemon.core.state import Core
from daemon.ipc.record import Level, Request


class Orders(NamedTuple):
    """What this cycle was asked to do."""

    stop: bool = False
    request: Request | None = None
    """New in this cycle, not judged yet."""


NO_ORDERS = Orders()


def hear(core: Core, levels: Sequence[Level], cycle: int) -> Orders:
    """Take in all levels that waited, oldest first."""
    stop = False
    newest: Level | None = None
    for level in levels:
        # The first level of all only tells where the count is: nothing is moving yet.
        known = core.stop_count
        more = known is None or level.stop_count > known
        stop = stop or (more and known is not None)
        newer = (
            level.core_boot_id == core.boot_id
            and level.seq > core.level_seq
            and level.for_cycle <= cycle
        )
        if more or newer:
            core.stop_count = level.stop_count
        if newer:
            core.level_seq, newest = level.seq, level
    if newest is None:
        return Orders(stop)
    core.level_cycle = max(core.level_cycle, newest.for_cycle)
    core.setpoints, core.lease = newest.setpoints, newest.lease
    return Orders(stop, newest.request if _is_new(core, newest.request) else None)


def _is_new(core: Core, request: Request) -> bool:
    return request.id > core.result.id
