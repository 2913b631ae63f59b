"""Converts robot.toml for the observer: the only place that converts its degrees to radians.

Slide, springs, dampers and friction are tables with the observer's numbers in the observer's order.
"""

import math

import msgspec

from daemon.config.settings import Robot, Segment
from daemon.config.unread import UNREAD, UnreadError
from observer.filter.leg_model import integrator_named
from observer.filter.leg_observer import ObserverTuning
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.parameters import (
    Dampers,
    Geometry,
    LegParameters,
    Link,
    Slide,
    Spring,
    with_patient,
)
from observer.mechanism.parameters import leg_parameters as compose


def leg_parameters(robot: Robot) -> LegParameters:
    """Geometry, inertia, springs and dampers of one leg, with the patient's leg if configured."""
    geometry = leg_geometry(robot)
    return compose(
        geometry,
        leg_links(robot),
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


def leg_links(robot: Robot) -> tuple[Link, Link, Link]:
    """Thigh, shank and shoe of the machine, with the patient's segments if configured."""
    machine = (_link(robot.thigh), _link(robot.shank), _link(robot.shoe))
    if robot.patient is None:
        return machine
    mass_kg, height_m = robot.patient.mass_kg, robot.patient.height_m
    return with_patient(machine, leg_geometry(robot), mass_kg, height_m)


def friction_parameters(robot: Robot) -> tuple[FrictionParameters, FrictionParameters]:
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
    )


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
