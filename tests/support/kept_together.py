"""Tests that begin with the same warm session are run by the same worker of pytest-xdist.

A warm session (`tests/support/forked.py`) or a running service is made once in each worker that
needs it; all those of the closed loop cost more than 30 CPU-seconds. `worksteal` gives each worker
a run of the items, and a worker without work takes from the end of another one's. So the tests of a
folder that share one come first in a worker's run, and all others after them. A plugin of pytest.
"""

from collections import defaultdict

import pytest
from cpu_seconds import group_of
from forked import PREFIX

SERVICE = "long_service"


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """After tests have been deselected; all workers find the same order."""
    count = getattr(config, "workerinput", {}).get("workercount", 1)
    if count > 1:
        items[:] = ordered(items, count)


def ordered(items: list[pytest.Item], count: int) -> list[pytest.Item]:
    """The items in `count` runs as long as those of `worksteal`, each group at the head of one."""
    groups: dict[str, list[pytest.Item]] = defaultdict(list)
    others: list[pytest.Item] = []
    for item in items:
        (groups[group_of(item.nodeid)] if shares(item) else others).append(item)
    heads: list[list[pytest.Item]] = [[] for _ in range(count)]
    for group in sorted(groups.values(), key=len, reverse=True):
        min(heads, key=len).extend(group)
    in_order: list[pytest.Item] = []
    for number, head in enumerate(heads):
        length = (len(items) - len(in_order)) // (count - number)
        filling = max(length - len(head), 0)
        in_order += head + others[:filling]
        del others[:filling]
    return in_order


def shares(item: pytest.Item) -> bool:
    """Return whether it begins with a warm session or the running service."""
    names = getattr(item, "fixturenames", ())
    return any(name.startswith(PREFIX) or name == SERVICE for name in names)
