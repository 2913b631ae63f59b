"""`gaitd bench`: the project's benchmarks, as ratios in one run, each with its budget."""

import importlib.util
import json as json_text
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from benchmarks.observer_step import StepTimes

PLAIN_WIDTH = 120
"""Columns of tables that are written to a file."""


def command(
    json: Annotated[bool, typer.Option("--json", help="print one JSON object")] = False,
    seconds: Annotated[
        float, typer.Option(min=2, max=25, help="of real time for each measurement on the bus")
    ] = 20.0,
    only: Annotated[
        list[str] | None, typer.Option(help="one of the benchmarks, by name; may be repeated")
    ] = None,
) -> None:
    """Run the benchmarks: observer step, scaling, cycle, SYNC lateness, replay, service, peers.

    Names: observer_step, scaling, cycle, lateness, lateness_under_load,
    replay, service, peers.
    """
    from rich.console import Console

    from gaitd.places import configs_folder
    from gaitd_lab.benchmark.tables import plain

    console = Console(stderr=json)
    if not console.is_terminal:
        console = Console(stderr=json, width=PLAIN_WIDTH)
    configs = configs_folder("configs", "demo.toml")
    results: dict[str, object] = {}
    measures = _measures(configs, seconds)
    for name in only or measures:
        if name not in measures:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(measures)}")
        with console.status(f"measuring: {name}"):
            results[name], table = measures[name]()
        if not json:
            for one in table if isinstance(table, list) else [table]:
                console.print(one)
    if json:
        print(json_text.dumps({name: plain(found) for name, found in results.items()}, indent=2))


def _measures(
    configs: Path, seconds: float
) -> "dict[str, Callable[[], tuple[object, Table | list[Table] | str]]]":
    """Benchmarks by name in the order of the output; each returns its result and its table."""
    return {
        "observer_step": lambda: _steps(configs),
        "scaling": lambda: _scaling(configs),
        "cycle": lambda: _cycle(configs),
        "lateness": lambda: _lateness(configs, seconds, 0),
        "lateness_under_load": lambda: _lateness(configs, seconds, os.cpu_count() or 1),
        "replay": lambda: _replay(configs),
        "service": lambda: _service(configs, seconds),
        "peers": lambda: _peers(configs, seconds),
    }


def _steps(configs: Path) -> "tuple[tuple[StepTimes, ...] | str, Table | str]":
    """Measure the observer's step with `benchmarks/`; a text if that folder is not installed."""
    from gaitd_lab.benchmark import tables

    title = "the observer's step, against hand-written C and FilterPy"
    root = Path(__file__).resolve().parent.parent
    if not (root / "benchmarks" / "observer_step.py").exists():
        word = "skipped: benchmarks/ is part of the repository, and is not installed"
        return word, f"{title}: {word}"
    if importlib.util.find_spec("benchmarks") is None:
        sys.path.insert(0, str(root))
    from gaitd_lab.benchmark.steps import measure

    found = measure(configs / "robot.toml")
    return found, tables.steps(title, found)


def _scaling(configs: Path) -> "tuple[object, Table]":
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml
    from gaitd_lab.benchmark import tables
    from gaitd_lab.benchmark.scaling import measure

    found = measure(load_toml(configs / "robot.toml", Robot))
    return found, tables.scaling("recordings and legs in one process, each step of each", found)


def _cycle(configs: Path) -> "tuple[object, Table]":
    from daemon.preflight.load import load
    from gaitd_lab.benchmark import tables
    from gaitd_lab.benchmark.cycle_parts import measure

    found = measure(load(configs / "demo.toml"))
    return found, tables.cycle("Python time of one cycle, two drives, gait", found)


def _lateness(configs: Path, seconds: float, burner_count: int) -> "tuple[object, Table]":
    from gaitd_lab.benchmark import tables
    from gaitd_lab.benchmark.lateness import measure

    found = measure(configs, seconds, burner_count)
    load = f", beside {burner_count} processes that compute" if burner_count else ""
    return found, tables.lateness(f"SYNC in real time on the simulated bus{load}", found)


def _service(configs: Path, seconds: float) -> "tuple[object, list[Table]]":
    from gaitd_lab.benchmark import tables
    from gaitd_lab.benchmark.whole_service import measure

    found = measure(configs, seconds)
    return found, tables.service("the service as processes: start, memory, delivery", found)


def _peers(configs: Path, seconds: float) -> "tuple[object, list[Table] | str]":
    """Measure other CANopen masters with `benchmarks/`; a text if that folder is not installed."""
    from gaitd_lab.benchmark.peers import EMERGENCY_COUNT, PEER, ROUND_COUNT, measure

    title = "masters of the same virtual drives"
    if not PEER.exists():
        word = "skipped: benchmarks/ is part of the repository, and is not installed"
        return word, f"{title}: {word}"
    from gaitd_lab.benchmark.peer_table import ratios, tables

    cells = measure(configs, seconds, EMERGENCY_COUNT, ROUND_COUNT, _say)
    return {"cells": cells, "ratios": ratios(cells)}, tables(title, cells)


def _say(words: str) -> None:
    print(f"measuring: {words}", file=sys.stderr, flush=True)


def _replay(configs: Path) -> "tuple[object, Table]":
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml
    from gaitd_lab.benchmark import tables
    from gaitd_lab.benchmark.replay_speed import measure

    found = measure(load_toml(configs / "robot.toml", Robot))
    return found, tables.replay("replay of ten minutes", found)
