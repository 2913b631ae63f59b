"""What the gateway asks for: read from all waiting levels, the stop counts first of all."""

from collections.abc import Sequence
from typing import NamedTuple

from daemon.core.state import Core
from daemon.record import Level, Request


class Orders(NamedTuple):
    """What this cycle was asked to do."""

    stop: bool = False
    request: Request | None = None
    """New in this cycle, not judged yet."""


NO_ORDERS = Orders()


def hear(core: Core, levels: Sequence[Level], cycle: int) -> Orders:
    """Take in all levels that waited. A stop counts from anybody, the rest only for this core."""
    stop = False
    newest: Level | None = None
    for level in levels:
        # The first level of all only tells where the count is: nothing is moving yet.
        stop = stop or (core.stop_count is not None and level.stop_count > core.stop_count)
        core.stop_count = level.stop_count
        if level.core_boot_id == core.boot_id and level.for_cycle <= cycle:
            newest = level
    if newest is None:
        return Orders(stop)
    core.level_cycle = max(core.level_cycle, newest.for_cycle)
    core.setpoints, core.lease = newest.setpoints, newest.lease
    return Orders(stop, newest.request if _is_new(core, newest.request) else None)


def _is_new(core: Core, request: Request) -> bool:
    outstanding = core.request.id if core.request else 0
    return request.id not in {0, outstanding, core.result.id}
