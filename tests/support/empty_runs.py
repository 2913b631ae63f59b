"""Recordings of an empty machine whose truth is known: fine steps, paper's friction, encoders."""

from pathlib import Path

import numpy as np
from gaitd_toml import load_toml

from analysis.recording import recording
from analysis.replay import Source
from daemon.config.robot import friction_parameters, leg_parameters
from daemon.config.settings import Robot
from observer.jit import kernel
from observer.mechanism.friction import (
    EVERYWHERE,
    FrictionParameters,
    OverPosition,
    at_position,
    friction_after,
)
from observer.mechanism.linkage import bounded_acceleration
from observer.mechanism.mechanism import gravity

ROBOT_FILE = Path(__file__).parents[2] / "configs" / "robot_empty.toml"
MIDDLE = np.array([0.2440, 0.5905])
STEP_S = 1e-4
STEPS = 100
QUANTUM = np.array([1e-4, 5e-5])
NOISE = np.array([5e-5, 2e-5])


@kernel
def _simulate(leg, hip, slide, over_hip, over_slide, start, drive, position):
    q1, q2, v1, v2, f1, f2 = start[0], start[1], 0.0, 0.0, 0.0, 0.0
    for row in range(drive.shape[0]):
        for _ in range(STEPS):
            a1, a2, _ = bounded_acceleration(
                leg, q1, q2, v1, v2, drive[row, 0] - f1, drive[row, 1] - f2, 1.0
            )
            v1 += STEP_S * a1
            v2 += STEP_S * a2
            q1 += STEP_S * v1
            q2 += STEP_S * v2
            f1 = friction_after(at_position(hip, over_hip, q1), f1, v1, STEP_S)
            f2 = friction_after(at_position(slide, over_slide, q2), f2, v2, STEP_S)
        position[row, 0], position[row, 1] = q1, q2


def robot_file() -> Robot:
    return load_toml(ROBOT_FILE, Robot)


def random_friction(seed: int) -> tuple[FrictionParameters, FrictionParameters]:
    """Friction of hip and slide, over the range of what such machines have."""
    rng = np.random.default_rng(seed)

    def law(coulomb, viscous, peak, edge):
        fc, d, v_p, v_0 = (np.exp(rng.uniform(*np.log(x))) for x in (coulomb, viscous, peak, edge))
        stribeck = fc * rng.uniform(1.08, 1.4) + d * v_p
        speeds = v_p / rng.uniform(3.0, 8.0), v_p, v_0, rng.uniform(0.012, 0.03)
        return FrictionParameters(*map(float, (stribeck, fc, d, *speeds)))

    return (
        law((3.0, 12.0), (0.4, 2.0), (0.03, 0.08), (0.02, 0.05)),
        law((30.0, 120.0), (25.0, 120.0), (0.012, 0.035), (0.008, 0.02)),
    )


def empty_run(
    friction: tuple[FrictionParameters, FrictionParameters],
    *,
    seed: int = 1,
    duration_s: float = 25.0,
    slide: bool = True,
    disturbance=None,
    robot: Robot | None = None,
    over: tuple[OverPosition, OverPosition] = (EVERYWHERE, EVERYWHERE),
    offset: tuple[float, float] = (0.0, 0.0),
) -> Source:
    """Sines from sticking to fast about g of the mean pose, as `excite open_loop` plays them.

    `over` is how friction rises along the axes, `offset` what the drives show at no effort.
    """
    leg = leg_parameters(robot or robot_file())
    hip, rail = friction
    time_s = np.arange(round(duration_s / 0.01)) * 0.01
    louder = np.where(time_s > duration_s / 2, 1.15, 1.0)
    drive = np.column_stack(
        (
            1.7 * hip.coulomb * np.sin(2 * np.pi * 0.3 * time_s) * louder,
            -1.5 * rail.coulomb * np.sin(2 * np.pi * 0.2 * time_s) * louder * slide,
        )
    )
    drive += gravity(leg, MIDDLE)
    acting = drive if disturbance is None else drive + disturbance(time_s)
    position = np.empty(drive.shape)
    _simulate(leg, hip, rail, *over, MIDDLE, acting, position)
    noise = np.random.default_rng(seed).normal(size=position.shape) * NOISE
    measured = np.round((position + noise) / QUANTUM) * QUANTUM
    values = np.column_stack((time_s, measured, drive + np.array(offset)))
    return Source(recording("empty.csv", values), None, "", None)


def shipped_friction() -> tuple[FrictionParameters, FrictionParameters]:
    return friction_parameters(robot_file())


def write_csv(source: Source, path: Path) -> Path:
    made = source.recording
    head = "time_s,hip_angle_rad,slide_position_m,hip_torque_nm,slide_force_n"
    rows = np.column_stack((made.time_s, made.position, made.effort))
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.9g")
    return path
