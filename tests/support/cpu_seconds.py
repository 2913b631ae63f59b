"""CPU-seconds of a run of pytest, by group and by item: what the budget of `make test` counts.

Processor time says the same on a busy machine as on an idle one, so it can be compared between
runs. An item's figure includes its set-up and tear-down, and the processes that it started and
waited for; a shared fixture counts for the item that made it first. The group of an item is its
folder under `tests`. What no item used is collection, imports and pytest's own work.

`--cpu-seconds=FILE` prints the table. FILE holds the steps that ran before pytest (lint, types,
coverage), as lines `SECONDS NAME` that `scripts/cpu_seconds.py` wrote; /dev/null does as well.
"""

import resource
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any, Final

import pytest

SLOWEST_COUNT: Final = 10
OTHER: Final = "collection, imports, pytest"
OUTPUT: Final = "cpu_seconds"
"""Key of what a worker of pytest-xdist hands back."""


def cpu_s() -> float:
    """Processor time of this process and of its children that have ended, user and system."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def group_of(nodeid: str) -> str:
    """`tests/drives` for `tests/drives/test_units.py::test_a`."""
    return "/".join(nodeid.partition("::")[0].split("/")[:-1][:2])


class CpuSeconds:
    """The plugin; see `tests/conftest.py`."""

    def __init__(self, steps: Path) -> None:
        self._steps = steps
        self._by_item: Counter[str] = Counter()
        self._total_s = 0.0
        """Sum of the workers that have ended."""

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Measure one item."""
        begun_s = cpu_s()
        try:
            return (yield)
        finally:
            self._by_item[item.nodeid] += cpu_s() - begun_s

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """A worker hands its figures to the process that prints them."""
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput[OUTPUT] = (dict(self._by_item), cpu_s())

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any, error: object) -> None:
        """Add what a worker has measured; one that crashed has handed back nothing."""
        del error
        by_item, total_s = getattr(node, "workeroutput", {}).get(OUTPUT, ({}, 0.0))
        self._by_item.update(by_item)
        self._total_s += total_s

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the table."""
        if hasattr(terminalreporter.config, "workeroutput"):
            return
        own_s = resource.getrusage(resource.RUSAGE_SELF)
        total_s = self._total_s + own_s.ru_utime + own_s.ru_stime
        if not self._total_s:  # without workers the children are the items'
            total_s = cpu_s()
        groups = _steps(self._steps) + _groups(self._by_item, total_s)
        terminalreporter.section("CPU-seconds")
        for seconds, count, name in groups:
            items = f"{count:5} items" if count else " " * 11
            terminalreporter.write_line(f"{seconds:8.1f}  {items}  {name}")
        terminalreporter.write_line(f"{sum(one[0] for one in groups):8.1f}  in total")
        terminalreporter.write_line("the slowest:")
        for name, seconds in self._by_item.most_common(SLOWEST_COUNT):
            terminalreporter.write_line(f"{seconds:8.1f}  {name}")


def _steps(file: Path) -> list[tuple[float, int, str]]:
    rows = (line.split(maxsplit=1) for line in file.read_text(encoding="utf-8").splitlines())
    return [(float(seconds), 0, name) for seconds, name in rows]


def _groups(by_item: Counter[str], total_s: float) -> list[tuple[float, int, str]]:
    seconds: Counter[str] = Counter()
    counts: Counter[str] = Counter()
    for nodeid, spent_s in by_item.items():
        seconds[group_of(nodeid)] += spent_s
        counts[group_of(nodeid)] += 1
    rows = [(spent_s, counts[name], name) for name, spent_s in sorted(seconds.items())]
    return [*rows, (total_s - seconds.total(), 0, OTHER)]
