"""Tests that share what is made once are run by the same worker of pytest-xdist.

A warm session (`tests/support/forked.py`), a running service or a fixture of a module is made once
in each worker that needs it. `worksteal` gives each worker a run of the items, and a worker without
work takes from the end of another one's. So tests that share one come first in a worker's run, and
all others after them: all those of the closed loop cost more than 30 CPU-seconds, those of modules
60. A plugin of pytest.
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
        shared = shared_by(item)
        (groups[shared] if shared else others).append(item)
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


def shared_by(item: pytest.Item) -> str:
    """The folder of a warm session or a running service, or the file of a fixture; or nothing."""
    if not isinstance(item, pytest.Function):
        return ""
    if any(name.startswith(PREFIX) or name == SERVICE for name in item.fixturenames):
        return group_of(item.nodeid)
    file = item.nodeid.partition("::")[0]
    made = [one for several in item._fixtureinfo.name2fixturedefs.values() for one in several]
    is_shared = any((one.scope, one.baseid) == ("module", file) for one in made)
    return file if is_shared else ""
