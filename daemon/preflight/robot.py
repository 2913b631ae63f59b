"""Checks of a robot file by itself: what the observer, with or without a service, needs of it."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gaitd_toml import ConfigError, Document, Errors, PlainText, decoded, read_toml

from daemon.config.robot import friction_over_position, friction_parameters, leg_parameters
from daemon.config.settings import HipFriction, Robot, SlideFriction
from observer.filter.leg_model import (
    STABILITY_LIMIT,
    STEP_S,
    SUBSTEPS_MAX,
    integrator_named,
    substeps_needed,
)
from observer.filter.status import START_RATIO_MIN
from observer.mechanism.friction import (
    FrictionParameters,
    bristle_stability_number,
    levels_of,
    smallest_stribeck,
)
from observer.mechanism.mechanism import smallest_inertia

AXES: Final = ("hip", "slide")


def load_robot(path: Path) -> Robot:
    """Read a robot file that the observer can run with.

    Raises:
        ConfigError: as `load_toml`, or the observer cannot run with its numbers.
    """
    return decoded_robot(read_toml(path))


def decoded_robot(document: Document, *, to_calibrate: bool = False) -> Robot:
    """Convert a document into a robot that the observer can run with.

    Args:
        document: a robot file.
        to_calibrate: a law without a hump will do, as a calibration gives it one.

    Raises:
        ConfigError: as `decoded`, or the observer cannot run with its numbers.
    """
    file, robot = document.path, decoded(document, Robot)
    laws = bristles_are_whole if to_calibrate else friction_laws_are_laws
    errors = list(laws(file, robot))
    errors = errors or list(the_integrator_is_stable(file, robot, START_RATIO_MIN))
    if errors:
        raise ConfigError.combined(errors)
    return robot


def friction_laws_are_laws(file: Path, robot: Robot) -> Errors:
    """A hump of (13) that turns over; damping of bristles that an axis does not have."""
    for axis, f in enumerate(friction_parameters(robot)):
        least = smallest_stribeck(f)
        if f.stribeck <= least:
            allowed = f"> {least:.4g}, coulomb tanh(peak / transition) + viscous peak"
            yield ConfigError(file, friction_key(axis, "stribeck"), f.stribeck, allowed)
    yield from bristles_are_whole(file, robot)


def _levels(robot: Robot) -> Iterator[tuple[FrictionParameters, ...]]:
    """The extremes of friction along each axis."""
    return map(levels_of, friction_parameters(robot), friction_over_position(robot))


def bristles_are_whole(file: Path, robot: Robot) -> Errors:
    """Damping of bristles that an axis does not have."""
    for axis, f in enumerate(friction_parameters(robot)):
        if f.bristle_stiffness == 0.0 and f.bristle_damping != 0.0:
            stiffness = friction_key(axis, "bristle_stiffness").rpartition(".")[2]
            allowed = f"0 while {stiffness} is 0, which means no bristles"
            key = friction_key(axis, "bristle_damping")
            yield ConfigError(file, key, f.bristle_damping, allowed)


def the_integrator_is_stable(file: Path, robot: Robot, nearest_ratio: float) -> Errors:
    """Bristles, integrator or substeps with which the observer's model would be unstable.

    Args:
        file: for messages.
        robot: with friction laws that are laws.
        nearest_ratio: distance from the singularity to which the leg may come.
    """
    observer, laws = robot.observer, friction_parameters(robot)
    inertia = smallest_inertia(leg_parameters(robot), nearest_ratio)
    stiff = [
        error
        for axis, f in enumerate(laws)
        for error in _bristles_are_not_too_stiff(file, axis, f, inertia[axis])
    ]
    if stiff:
        yield from stiff
        return
    try:
        integrator = integrator_named(observer.integrator)
        pairs = itertools.product(*_levels(robot))
        least = max(substeps_needed(hip, slide, inertia, integrator) for hip, slide in pairs)
    except ValueError as error:
        value = PlainText(observer.integrator)
        yield ConfigError(file, "observer.integrator", value, str(error))
        return
    if observer.substeps < least:
        allowed = (
            f">= {least} and <= {SUBSTEPS_MAX}: {observer.integrator} with this friction is "
            "unstable below"
        )
        yield ConfigError(file, "observer.substeps", observer.substeps, allowed)


def _bristles_are_not_too_stiff(
    file: Path, axis: int, f: FrictionParameters, inertia: float
) -> Errors:
    dt_s = STEP_S / SUBSTEPS_MAX
    if f.bristle_stiffness == 0.0 or bristle_stability_number(f, inertia, dt_s) < STABILITY_LIMIT:
        return
    damped = bristle_stability_number(f._replace(bristle_stiffness=0.0), inertia, dt_s)
    if (left := STABILITY_LIMIT - damped) > 0.0:
        name, most = "bristle_stiffness", left * inertia / dt_s**2
    else:
        name, most = "bristle_damping", 0.5 * STABILITY_LIMIT * inertia / dt_s - f.viscous
    allowed = f"< {most:.4g}: {SUBSTEPS_MAX} substeps of semi_implicit are unstable above"
    yield ConfigError(file, friction_key(axis, name), getattr(f, name), allowed)


def friction_key(axis: int, name: str) -> str:
    """Dotted key of a friction parameter.

    Args:
        axis: 0 for the hip, 1 for the slide.
        name: field of `FrictionParameters`, whose order the tables have.
    """
    table = (HipFriction, SlideFriction)[axis]
    key = table.__struct_fields__[FrictionParameters._fields.index(name)]
    return f"friction.{AXES[axis]}.{key}"
