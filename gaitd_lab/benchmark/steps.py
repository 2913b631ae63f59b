"""The observer's step compared with its competitors, by `benchmarks/observer_step.py`."""

from pathlib import Path

from benchmarks.observer_step import INTEGRATORS, StepTimes
from benchmarks.observer_step import measure as measure_one
from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
from daemon.config.settings import Robot
from daemon.config.strict import load_toml


def measure(robot_file: Path) -> tuple[StepTimes, ...]:
    """Measure one row for each integrator and number of substeps."""
    robot = load_toml(robot_file, Robot)
    hip, slide = friction_parameters(robot)
    tuning = observer_tuning(robot)
    return tuple(
        measure_one(
            leg_parameters(robot),
            hip,
            slide,
            tuning._replace(integrator=integrator, substeps=substeps),
        )
        for integrator, substeps in INTEGRATORS
    )
