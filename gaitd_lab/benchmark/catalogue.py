"""All benchmarks by name: each measures and returns its rows of the table."""

import os
from collections.abc import Callable
from pathlib import Path

from gaitd_toml import load_toml

from daemon.config.settings import Robot
from daemon.preflight.load import load
from gaitd_lab.benchmark import (
    cycle_time,
    display_page,
    lateness,
    observer_step,
    peers,
    replay_speed,
    whole_service,
)
from gaitd_lab.benchmark.figures import Figure


def measurements(configs: Path, seconds: float) -> dict[str, Callable[[], list[Figure]]]:
    """Return the benchmarks by name, in the order of the table.

    Args:
        configs: folder of the shipped configurations.
        seconds: real time for each measurement on the bus.
    """

    def robot() -> Robot:
        return load_toml(configs / "robot.toml", Robot)

    busy = os.cpu_count() or 1
    return {
        "observer_step": lambda: observer_step.measure_all(robot()),
        "cycle": lambda: cycle_time.measure(load(configs / "demo.toml")),
        "lateness": lambda: lateness.measure(configs, seconds),
        "lateness_under_load": lambda: lateness.measure(configs, seconds, busy),
        "replay": lambda: replay_speed.measure(robot()),
        "service": lambda: whole_service.measure(configs, seconds),
        "peers": lambda: peers.measure(configs, seconds),
        "display": lambda: display_page.measure(configs, seconds),
    }
