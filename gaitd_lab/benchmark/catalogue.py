"""All benchmarks by name: each measures, and returns its result and its table."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rich.table import Table

from daemon.config.settings import Robot
from daemon.config.strict import load_toml
from daemon.preflight.load import load
from gaitd_lab.benchmark import (
    cycle_parts,
    display_page,
    lateness,
    peer_table,
    peers,
    replay_speed,
    scaling,
    tables,
    whole_service,
)
from gaitd_lab.peers.observer_step import measure_all

T = TypeVar("T")
Tables = Table | list[Table] | str
Measured = tuple[object, Tables]


def measurements(configs: Path, seconds: float) -> dict[str, Callable[[], Measured]]:
    """Return the benchmarks by name, in the order of the output.

    Args:
        configs: folder of the shipped configurations.
        seconds: real time for each measurement on the bus.
    """

    def robot() -> Robot:
        return load_toml(configs / "robot.toml", Robot)

    def with_table(title: str, result: T, table: Callable[[str, T], Tables]) -> Measured:
        return result, table(title, result)

    def late(burner_count: int, beside: str) -> Measured:
        title = f"SYNC in real time on the simulated bus{beside}"
        result = lateness.measure(configs, seconds, burner_count)
        return with_table(title, result, tables.lateness)

    busy = os.cpu_count() or 1
    return {
        "observer_step": lambda: _steps(configs),
        "scaling": lambda: with_table(
            "recordings and legs in one process, each step of each",
            scaling.measure(robot()),
            tables.scaling,
        ),
        "cycle": lambda: with_table(
            "Python time of one cycle, two drives, gait",
            cycle_parts.measure(load(configs / "demo.toml")),
            tables.cycle,
        ),
        "lateness": lambda: late(0, ""),
        "lateness_under_load": lambda: late(busy, f", beside {busy} processes that compute"),
        "replay": lambda: with_table(
            "replay of ten minutes", replay_speed.measure(robot()), tables.replay
        ),
        "service": lambda: with_table(
            "the service as processes: start, memory, delivery",
            whole_service.measure(configs, seconds),
            tables.service,
        ),
        "peers": lambda: _peers(configs, seconds),
        "display": lambda: _display(configs, seconds),
    }


def _steps(configs: Path) -> Measured:
    result = measure_all(load_toml(configs / "robot.toml", Robot))
    return result, tables.steps("the observer's step, against hand-written C and FilterPy", result)


def _display(configs: Path, seconds: float) -> Measured:
    """Measure the patient's page; a text if browser or page is not installed."""
    title = "the patient's page in headless Chromium, both legs walking"
    if (lack := display_page.lacks()) is not None:
        return f"skipped: {lack}", f"{title}: skipped, {lack}; `make rigs` installs what it needs"
    result = display_page.measure(configs, seconds)
    return result, tables.display(title, result)


def _peers(configs: Path, seconds: float) -> Measured:
    title = "masters of the same virtual drives"

    def show(text: str) -> None:
        print(f"measuring: {text}", file=sys.stderr, flush=True)

    cells = peers.measure(configs, seconds, peers.EMERGENCY_COUNT, peers.ROUND_COUNT, show)
    return {"cells": cells, "ratios": peer_table.ratios(cells)}, peer_table.tables(title, cells)
