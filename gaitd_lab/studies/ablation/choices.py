"""Every choice of the observer, as a change of the robot file: the variants of the ablation."""

from collections.abc import Callable
from typing import Final, NamedTuple, TypeVar

import msgspec

from daemon.config.edits import replaced
from daemon.config.settings import Robot

Table = TypeVar("Table", bound=msgspec.Struct)

SHIPPED: Final = "as shipped"
PAPER_FRICTION_FACTOR: Final = 10.0
"""Factor on friction's process noise in the paper's tuning: q_fric >> q_dist."""
NO_FRICTION: Final = 1e-6
"""N·m or N: levels that stand for no friction; the law needs positive ones."""
OPEN_GATE_NIS: Final = 1000.0
DELAY_MS: Final = 10.0
JITTER_S: Final = 1e-3
RIPPLE: Final = (0.1, 8.0)
"""N·m and N, as caused by the drives' own loops in position mode."""


class Choice(NamedTuple):
    """One configuration of the observer."""

    name: str
    change: Callable[[Robot], Robot]


def _as_it_is(robot: Robot) -> Robot:
    return robot


def _observer(**changes: object) -> Callable[[Robot], Robot]:
    """Replace keys of [observer]."""
    return lambda robot: replaced(robot, {f"observer.{key}": new for key, new in changes.items()})


def friction_levels(factor: float, viscous_factor: float = 1.0) -> Callable[[Robot], Robot]:
    """Scale Coulomb and breakaway levels, and viscous friction."""

    def change(robot: Robot) -> Robot:
        hip = _scaled(
            robot.friction.hip,
            coulomb_nm=factor,
            stribeck_nm=factor,
            viscous_nm_s_per_rad=viscous_factor,
        )
        slide = _scaled(
            robot.friction.slide,
            coulomb_n=factor,
            stribeck_n=factor,
            viscous_n_s_per_m=viscous_factor,
        )
        friction = msgspec.structs.replace(robot.friction, hip=hip, slide=slide)
        return msgspec.structs.replace(robot, friction=friction)

    return change


def _leg_mass(factor: float) -> Callable[[Robot], Robot]:
    """Scale the mass of the patient, or of the machine's links where it is empty."""

    def change(robot: Robot) -> Robot:
        parts = ("thigh", "shank", "shoe") if robot.patient is None else ("patient",)
        scaled = {name: _scaled(getattr(robot, name), mass_kg=factor) for name in parts}
        return msgspec.structs.replace(robot, **scaled)

    return change


def _scaled(table: Table, **factors: float) -> Table:
    """Multiply keys of a table."""
    changes = {key: factor * getattr(table, key) for key, factor in factors.items()}
    return msgspec.structs.replace(table, **changes)


def _paper_noise(robot: Robot) -> Robot:
    """Constant noise with q_fric >> q_dist, which assigns changes at rest to friction."""
    table = robot.observer
    return _observer(
        velocity_gated=False,
        patient_noise_max_ratio=1.0,
        hip=replaced(
            table.hip, {"process_friction_nm": PAPER_FRICTION_FACTOR * table.hip.process_patient_nm}
        ),
        slide=replaced(
            table.slide,
            {"process_friction_n": PAPER_FRICTION_FACTOR * table.slide.process_patient_n},
        ),
    )(robot)


def _paper(robot: Robot) -> Robot:
    """The paper's model and tuning, which also omits the Coriolis torque."""
    return _observer(coriolis=False)(_paper_noise(robot))


def _rippled(robot: Robot) -> Robot:
    hip, slide = RIPPLE
    return replaced(robot, {"observer.hip.ripple_nm": hip, "observer.slide.ripple_n": slide})


CHOICES: Final = (
    Choice(SHIPPED, _as_it_is),
    Choice("without Coriolis", _observer(coriolis=False)),
    Choice("not gated at rest", _observer(velocity_gated=False)),
    Choice("noise never rises", _observer(patient_noise_max_ratio=1.0)),
    Choice("semi-implicit x1", _observer(integrator="semi_implicit", substeps=1)),
    Choice("semi-implicit x2", _observer(integrator="semi_implicit", substeps=2)),
    Choice("viscous outside", _observer(viscous_outside=True)),
    Choice("no friction model", friction_levels(NO_FRICTION, 0.0)),
    Choice("paper's noise", _paper_noise),
    Choice("paper's observer", _paper),
    Choice("glitch gate open", _observer(gate_nis=OPEN_GATE_NIS)),
    Choice("delay configured", _observer(effort_delay_ms=DELAY_MS)),
    Choice("jitter configured", _observer(sample_jitter_us=1e6 * JITTER_S)),
    Choice("ripple configured", _rippled),
    Choice("friction set 20 % low", friction_levels(0.8)),
    Choice("friction set 20 % high", friction_levels(1.2)),
    Choice("leg set 10 % light", _leg_mass(0.9)),
    Choice("leg set 10 % heavy", _leg_mass(1.1)),
)
