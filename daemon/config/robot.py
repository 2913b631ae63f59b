"""Converts robot.toml for the observer: the only place that converts its degrees to radians.

Slide, springs, dampers and friction are tables with the observer's numbers in the observer's order.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from typing import Final, TypeVar

import msgspec
from msgspec.structs import replace

from daemon.config.limit_settings import Limits
from daemon.config.settings import Robot, Segment
from daemon.config.unread import UNREAD, UnreadError
from observer.filter.considered import Drives, Slopes, Variant
from observer.filter.leg_model import integrator_named
from observer.filter.leg_observer import ObserverTuning
from observer.mechanism.friction import FrictionParameters, OverPosition, at_position
from observer.mechanism.parameters import (
    BODY,
    BodySegment,
    Dampers,
    Geometry,
    LegParameters,
    Link,
    Slide,
    Spring,
    with_patient,
)
from observer.mechanism.parameters import leg_parameters as compose

Body = tuple[BodySegment, BodySegment, BodySegment]
Frictions = tuple[FrictionParameters, FrictionParameters]
"""Friction of hip and slide."""
Part = TypeVar("Part", bound=msgspec.Struct)

_PARAMETERS: Final = (
    ("length_m", "geometry.thigh_length_m"),
    ("length_m", "geometry.shank_length_m"),
    ("length_m", "geometry.shoe_length_m"),
    ("rail_m", "geometry.rail_x_m"),
    ("rail_m", "geometry.rail_y_m"),
    ("recline_deg", "geometry.recline_deg"),
    ("rail_angle_deg", "geometry.rail_angle_deg"),
    (
        "machine_mass_ratio",
        *("thigh.mass_kg", "thigh.inertia_kg_m2", "shank.mass_kg", "shank.inertia_kg_m2"),
        *("shoe.mass_kg", "shoe.inertia_kg_m2", "slide.mass_kg"),
    ),
    ("drive_inertia_ratio", "hip.drive_inertia_kg_m2", "slide.drive_mass_kg"),
    (
        "damping_ratio",
        *("dampers.hip_nm_s_per_rad", "dampers.knee_nm_s_per_rad"),
        *("dampers.ankle_nm_s_per_rad", "dampers.slide_joint_nm_s_per_rad"),
    ),
    ("hip.spring_ratio", "springs.hip.stiffness_nm_per_rad"),
    ("hip.spring_rest_rad", "springs.hip.rest_rad"),
    ("slide.spring_ratio", "springs.slide.stiffness_n_per_m"),
    ("slide.spring_rest_m", "springs.slide.rest_m"),
    ("hip.friction_ratio", "friction.hip.stribeck_nm", "friction.hip.coulomb_nm"),
    ("slide.friction_ratio", "friction.slide.stribeck_n", "friction.slide.coulomb_n"),
    ("hip.viscous_ratio", "friction.hip.viscous_nm_s_per_rad"),
    ("slide.viscous_ratio", "friction.slide.viscous_n_s_per_m"),
)
"""Parameters of the file that are not sure: their key in [uncertainty], and the keys that change
together. A ratio multiplies them, another deviation is added."""


def leg_parameters(robot: Robot, body: Body = BODY) -> LegParameters:
    """Geometry, inertia, springs and dampers of one leg, with the patient's leg if configured."""
    geometry = leg_geometry(robot)
    return compose(
        geometry,
        leg_links(robot, body),
        Slide(*_values(robot.slide)),
        robot.hip.drive_inertia_kg_m2,
        (Spring(*_values(robot.springs.hip)), Spring(*_values(robot.springs.slide))),
        Dampers(*_values(robot.dampers)),
    )


def leg_geometry(robot: Robot) -> Geometry:
    """[geometry] in rad."""
    table = robot.geometry
    return Geometry(
        table.thigh_length_m,
        table.shank_length_m,
        table.shoe_length_m,
        math.radians(table.recline_deg),
        table.rail_x_m,
        table.rail_y_m,
        math.radians(table.rail_angle_deg),
        math.radians(table.thigh_offset_deg),
    )


def leg_links(robot: Robot, body: Body = BODY) -> tuple[Link, Link, Link]:
    """Thigh, shank and shoe of the machine, with the patient's segments if configured."""
    machine = (_link(robot.thigh), _link(robot.shank), _link(robot.shoe))
    if robot.patient is None:
        return machine
    mass_kg, height_m = robot.patient.mass_kg, robot.patient.height_m
    return with_patient(machine, leg_geometry(robot), mass_kg, height_m, body)


def friction_parameters(robot: Robot) -> Frictions:
    """Friction of hip (N m, rad/s) and slide (N, m/s)."""
    hip, slide = robot.friction.hip, robot.friction.slide
    return FrictionParameters(*_values(hip)), FrictionParameters(*_values(slide))


def observer_tuning(robot: Robot) -> ObserverTuning:
    """Noise, integrator and gate of the observer."""
    table = robot.observer
    hip, slide = table.hip, table.slide
    return ObserverTuning(
        process_std=(
            *(hip.process_angle_rad, slide.process_position_m),
            *(hip.process_velocity_rad_per_s, slide.process_velocity_m_per_s),
            *(hip.process_friction_nm, slide.process_friction_n),
            *(hip.process_patient_nm, slide.process_patient_n),
        ),
        measurement_std=(hip.measurement_angle_rad, slide.measurement_position_m),
        coriolis=table.coriolis,
        velocity_gated=table.velocity_gated,
        integrator=integrator_named(table.integrator),
        substeps=table.substeps,
        gate_nis=table.gate_nis,
        patient_noise_max_ratio=table.patient_noise_max_ratio,
        viscous_outside=table.viscous_outside,
        effort_delay_ms=table.effort_delay_ms,
        sample_jitter_us=table.sample_jitter_us,
        ripple=(hip.ripple_nm, slide.ripple_n),
        law=(hip.law_nm, slide.law_n),
        compliance=(
            _compliance(robot.transmission.hip.stiffness_nm_per_rad),
            _compliance(robot.transmission.slide.stiffness_n_per_m),
        ),
        backlash=(robot.transmission.hip.backlash_rad, robot.transmission.slide.backlash_m),
        effort_offset=(robot.effort_offset.hip.torque_nm, robot.effort_offset.slide.force_n),
        friction_over_position=friction_over_position(robot),
    )


def friction_over_position(robot: Robot) -> tuple[OverPosition, OverPosition]:
    """How friction rises along hip and slide."""
    table = robot.friction_over_position
    return OverPosition(*_values(table.hip)), OverPosition(*_values(table.slide))


def friction_range(robot: Robot, limits: Limits) -> tuple[Frictions, Frictions]:
    """The least and the greatest friction of hip and slide between their position limits.

    A check takes the one that is worse for what it shows: a leg without its drives goes farthest
    with the least, and the greatest hides most at rest.
    """
    hip, slide = limits.hip, limits.slide
    ends = (
        (math.radians(hip.position_min_deg), math.radians(hip.position_max_deg)),
        (slide.position_min_m, slide.position_max_m),
    )
    (hip_least, hip_most), (slide_least, slide_most) = (
        sorted((at_position(law, over, end) for end in both), key=lambda found: found.stribeck)
        for law, over, both in zip(
            friction_parameters(robot), friction_over_position(robot), ends, strict=True
        )
    )
    return (hip_least, slide_least), (hip_most, slide_most)


def _compliance(stiffness: float) -> float:
    return 1.0 / stiffness if stiffness > 0.0 else 0.0


def considered(robot: Robot) -> tuple[Variant, ...]:
    """The physics with each parameter that is not sure one standard deviation larger."""
    return tuple(_variants(robot))


def frictional(robot: Robot) -> tuple[bool, ...]:
    """Which of the considered parameters are of friction."""
    friction = (*friction_parameters(robot), Slopes())
    return tuple((one.hip, one.slide, one.slopes) != friction for one in considered(robot))


def _variants(robot: Robot) -> Iterator[Variant]:
    for key, *places in _PARAMETERS:
        std = attrgetter(key)(robot.uncertainty)
        if std > 0.0:
            changed = robot
            for place in places:
                change = _scaled(std) if key.endswith("_ratio") else _moved(std)
                changed = _changed(changed, place.split("."), change)
            yield _variant(changed)
    segment_ratio = robot.uncertainty.body_segment_ratio
    if robot.patient is not None and segment_ratio > 0.0:
        for index in range(len(BODY)):
            yield _variant(robot, _heavier(index, 1.0 + segment_ratio))
    hip, slide = robot.uncertainty.hip, robot.uncertainty.slide
    for shown in (
        Drives(effort_ratio_hip=1.0 + hip.torque_ratio),
        Drives(effort_ratio_slide=1.0 + slide.force_ratio),
        Drives(effort_offset_hip_nm=hip.torque_offset_nm),
        Drives(effort_offset_slide_n=slide.force_offset_n),
        Drives(position_offset_hip_rad=math.radians(hip.angle_deg)),
        Drives(position_offset_slide_m=slide.position_m),
    ):
        if shown != Drives():
            yield _variant(robot)._replace(drives=shown)
    for slopes in (
        Slopes(hip_per_rad=hip.friction_slope_per_rad),
        Slopes(slide_per_m=slide.friction_slope_per_m),
    ):
        if slopes != Slopes():
            yield _variant(robot)._replace(slopes=slopes)


def _variant(robot: Robot, body: Body = BODY) -> Variant:
    return Variant(leg_parameters(robot, body), *friction_parameters(robot))


def _heavier(index: int, ratio: float) -> Body:
    """The table's body with one segment heavier."""
    thigh, shank, foot = (
        one._replace(mass_per_body_mass=ratio * one.mass_per_body_mass) if k == index else one
        for k, one in enumerate(BODY)
    )
    return thigh, shank, foot


def _scaled(std_ratio: float) -> Callable[[float], float]:
    return lambda value: value * (1.0 + std_ratio)


def _moved(std: float) -> Callable[[float], float]:
    return lambda value: value + std


def _changed(table: Part, place: Sequence[str], change: Callable[[float], float]) -> Part:
    """The table with the value at a place, `("springs", "hip", "rest_rad")`, changed."""
    name, *rest = place
    value = getattr(table, name)
    return replace(table, **{name: _changed(value, rest, change) if rest else change(value)})


def _link(segment: Segment) -> Link:
    return Link(
        segment.mass_kg,
        segment.com_ratio,
        math.radians(segment.com_offset_deg),
        segment.inertia_kg_m2,
    )


def _values(table: msgspec.Struct) -> tuple[float, ...]:
    if table is UNREAD:
        raise UnreadError
    return msgspec.structs.astuple(table)
