"""Tests that share a fixture stay together: the order of the items of `tests/support`."""

from types import SimpleNamespace

import kept_together

WORKERS = 3
COUNTS = {"a": 7, "b": 5, "c": 4, "": 31}


def runs_of(items):
    """As `worksteal` deals them out: each worker gets its share of what is left."""
    for workers_left in range(WORKERS, 0, -1):
        length = len(items) // workers_left
        yield items[:length]
        items = items[length:]


def test_each_group_is_at_the_head_of_one_workers_run(monkeypatch):
    monkeypatch.setattr(kept_together, "shared_by", lambda item: item.group)
    items = [
        SimpleNamespace(group=group)
        for at in range(max(COUNTS.values()))
        for group, count in COUNTS.items()
        if at < count
    ]

    in_order = kept_together.ordered(items, WORKERS)

    assert sorted(map(id, in_order)) == sorted(map(id, items))
    heads = [[one.group for one in run] for run in runs_of(in_order)]
    for run, name in zip(heads, "abc", strict=True):
        assert run == COUNTS[name] * [name] + (len(run) - COUNTS[name]) * [""]
