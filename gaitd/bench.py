"""`gaitd bench`: the project's benchmarks, as ratios and shares measured in one run."""

import importlib
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.table import Table

PROJECT = Path(__file__).resolve().parent.parent
GRID_S = 15.0
RECORDED_S = 3600.0


def command(
    as_json: Annotated[bool, typer.Option("--json", help="numbers for a program")] = False,
) -> None:
    """Observer's step, one cycle by part, SYNC lateness, replay speed."""
    from gaitd.benchmarking import cycle_parts, replay_speed, sync_grid
    from gaitd.places import configs_folder

    configs = configs_folder("configs", "demo.toml")
    results: dict[str, Any] = {}
    results["step"] = list(_steps(configs))
    results["cycle"] = [part._asdict() for part in cycle_parts.measure(configs)]
    try:
        results["grid"] = sync_grid.measure(configs, GRID_S)._asdict()
    except sync_grid.NotReadyError as error:
        print(f"SYNC lateness is left out: {error}", file=sys.stderr)
    results["replay"] = replay_speed.measure(configs, RECORDED_S)._asdict()
    if as_json:
        print(json.dumps(results))
    else:
        _show(results)


def _steps(configs: Path) -> Iterator[dict[str, Any]]:
    """The observer's step and its competitors, where the repository's benchmarks are there."""
    from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml

    if not (PROJECT / "benchmarks" / "observer_step.py").exists():
        print("the observer's competitors are left out: no benchmarks/ here", file=sys.stderr)
        return
    sys.path.insert(0, str(PROJECT))
    observer_step = importlib.import_module("benchmarks.observer_step")
    robot = load_toml(configs / "robot.toml", Robot)
    hip, slide = friction_parameters(robot)
    tuning = observer_tuning(robot)
    for integrator, substeps in observer_step.INTEGRATORS:
        row = observer_step.measure(
            leg_parameters(robot),
            hip,
            slide,
            tuning._replace(integrator=integrator, substeps=substeps),
        )
        yield asdict(row)


def _show(results: dict[str, Any]) -> None:
    from rich.console import Console

    console = Console()
    for table in _tables(results):
        console.print(table)


def _tables(results: dict[str, Any]) -> "Iterator[Table]":
    from rich.table import Table

    steps = Table(title="one step of the observer, µs (median)", title_justify="left")
    for name in ("integrator", "observer", "live", "C", "FilterPy", "to C", "FilterPy to live"):
        steps.add_column(name, justify="right")
    for row in results["step"]:
        steps.add_row(*_step_cells(row))
    yield steps

    parts = Table(title="Python time of one cycle, two drives, µs", title_justify="left")
    for name in ("part", "median", "99.9 %", "share of the whole"):
        parts.add_column(name, justify="right")
    whole_us = next(p["median_us"] for p in results["cycle"] if p["name"] == "whole cycle")
    for part in results["cycle"]:
        share = f"{part['median_us'] / whole_us:.0%}"
        parts.add_row(part["name"], f"{part['median_us']:.1f}", f"{part['p999_us']:.1f}", share)
    yield parts

    if "grid" in results:
        yield _grid_table(results["grid"])

    replay = results["replay"]
    speed = Table(title="replay, times real time", title_justify="left")
    for name in ("recording", "computing", "with CSV in and out"):
        speed.add_column(name, justify="right")
    speed.add_row(
        f"{replay['recorded_s'] / 3600:g} h",
        f"{replay['computing_ratio']:.0f} ×",
        f"{replay['with_csv_ratio']:.0f} ×",
    )
    yield speed


def _step_cells(row: dict[str, Any]) -> tuple[str, ...]:
    c_us, filterpy_us = row["c_us"], row["filterpy_us"]
    return (
        f"{row['integrator']} × {row['substeps']}",
        f"{row['observer_us']:.1f}",
        f"{row['live_us']:.1f}",
        f"{c_us:.1f}" if c_us else "no compiler",
        f"{filterpy_us:.0f}" if filterpy_us else "–",
        f"{row['observer_us'] / c_us:.2f}" if c_us else "–",
        f"{filterpy_us / row['live_us']:.0f} ×" if filterpy_us else "–",
    )


def _grid_table(grid: dict[str, Any]) -> "Table":
    from rich.table import Table

    from gaitd.benchmarking.sync_grid import EDGES_US

    title = (
        f"SYNC on the loopback bus, {grid['cycle_count']} cycles, {grid['overrun_count']} overruns"
    )
    table = Table(title=title, title_justify="left")
    for name in ("µs", "median", "99 %", "99.9 %", "worst"):
        table.add_column(name, justify="right")
    table.add_row("late", *(f"{value:.0f}" for value in grid["lateness_us"]))
    table.add_row("until both answered", *(f"{value:.0f}" for value in grid["collect_us"]))
    labels = [f"≤ {edge}" for edge in EDGES_US] + [f"> {EDGES_US[-1]}"]
    counts = ", ".join(
        f"{label}: {count}" for label, count in zip(labels, grid["histogram"], strict=True) if count
    )
    table.caption = f"lateness in µs, cycles: {counts}"
    return table
