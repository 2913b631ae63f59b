"""Plants of configs/plant.toml with a few tables changed, and orders for their axes."""

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import msgspec

from daemon.config.robot import friction_parameters, leg_parameters
from daemon.config.settings import Robot
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.parameters import LegParameters
from sim_drives.plant.actuation import Actuation, AxisActuation
from sim_drives.plant.plant import COASTING, HIP, SLIDE, Physics, Trainer
from sim_drives.plant.settings import PlantTables

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
MS = 1_000_000
SECOND = 1000 * MS
EFFORT_PER_A = (0.055736 * 100, 0.107746 * 6 * 2 * math.pi / 0.15)
EFFORT_LIMIT = (66.0, 540.0)
DRIVE_INERTIA = (0.35, 6.0)

PASSIVE = {"start": "passive", "activation_s": 0.0, "programme": [{"name": "passive"}]}
QUIET = {
    "latch_jitter_us": 0.0,
    "hip": {"position_noise_rad": 0.0, "current_noise_a": 0.0},
    "slide": {"position_noise_m": 0.0, "current_noise_a": 0.0},
}


def merged(table: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A table with some of its keys, at any depth, changed."""
    result = dict(table)
    for key, value in changes.items():
        below = isinstance(value, dict) and key in result
        result[key] = merged(result[key], value) if below else value
    return result


def plant_tables(**changes: Any) -> PlantTables:
    """The physics tables of configs/plant.toml, with changes."""
    table = tomllib.loads((CONFIGS / "plant.toml").read_text())
    known = {key: value for key, value in table.items() if key not in ("drives", "fault")}
    return msgspec.convert(merged(known, changes), PlantTables)


def robot(name: str = "robot.toml", **changes: Any) -> Robot:
    """A robot file, with changes."""
    table = tomllib.loads((CONFIGS / name).read_text())
    return msgspec.convert(merged(table, changes), Robot)


LEG: LegParameters = leg_parameters(robot())
FRICTIONS: tuple[FrictionParameters, FrictionParameters] = friction_parameters(robot())


def trainer(
    leg: LegParameters = LEG,
    frictions: tuple[FrictionParameters, FrictionParameters] = FRICTIONS,
    seed: int = 1,
    **changes: Any,
) -> Trainer:
    """A plant at time 0."""
    physics = Physics(leg, frictions, DRIVE_INERTIA)
    return Trainer(plant_tables(**changes), physics, EFFORT_PER_A, seed, start_ns=0)


def programme(*efforts: dict[str, Any], activation_s: float = 0.0) -> dict[str, Any]:
    """A [patient] table with one programme, running from the start; keys as in a file: `hip.X`."""
    rest = {"at_s": 0.0, "until_s": 1e6, "rise_s": 0.0, "fall_s": 0.0}
    rest |= {"hip.torque_nm": 0.0, "slide.force_n": 0.0}
    lines = [
        "\n".join(f"{key} = {json.dumps(x)}" for key, x in (rest | e).items()) for e in efforts
    ]
    parts = [tomllib.loads(line) for line in lines]
    return {
        "start": "script",
        "activation_s": activation_s,
        "programme": [{"name": "script", "effort": parts}, {"name": "passive"}],
    }


def order(axis: int, actuation: Actuation, **changes: float) -> AxisActuation:
    """An order with generous limits."""
    general = COASTING._replace(
        actuation=actuation,
        effort_limit_si=EFFORT_LIMIT[axis],
        velocity_limit_si=10.0,
        deceleration_si=5.0,
    )
    return general._replace(**changes)


def torque(plant: Trainer, hip_nm: float, slide_n: float) -> None:
    """Order both axes' torque."""
    plant.set_axis(HIP, order(HIP, Actuation.TORQUE, target_effort_si=hip_nm))
    plant.set_axis(SLIDE, order(SLIDE, Actuation.TORQUE, target_effort_si=slide_n))


def run(plant: Trainer, seconds: float) -> None:
    """Let the plant live, past all flags."""
    until_ns = plant.now_ns + round(seconds * SECOND)
    while plant.now_ns < until_ns:
        plant.advance(until_ns)
