"""Parameters of a leg: the links as in a drawing, and the derived numbers for the kernels.

`leg_parameters` composes a `LegParameters` once, outside the kernels. A link's centre of mass is
polar: a ratio of the link's length from its proximal joint, and an angle from the link's line,
counter-clockwise positive. Lengths in m, masses in kg, inertias in kg m^2.
"""

import cmath
import math
from typing import Final, NamedTuple

from observer.quantities import Area, Inertia, Mass, Number, Stiffness, Viscosity

GRAVITY: Final = 9.81
"""m/s^2, as in the golden vectors."""
SMALLEST_RATIO: Final = 0.01
"""|sin| of the angle between shank and shoe below which the mechanism counts as not closing."""


class Geometry(NamedTuple):
    """Link lengths and the position of the rail; the hip is the origin, x forward, y up."""

    thigh_length_m: float
    shank_length_m: float
    shoe_length_m: float
    recline_rad: float
    """Angle of the trunk from the vertical."""
    rail_x_m: float
    rail_y_m: float
    """Position of the slide's joint at slide position 0."""
    rail_angle_rad: float
    thigh_offset_rad: float = 0.0
    """Angle of the thigh's line at hip angle 0 from the trunk's line."""


class Link(NamedTuple):
    """Inertia of one moving link."""

    mass_kg: float
    com_ratio: float
    com_offset_rad: float
    inertia_kg_m2: float
    """About the centre of mass."""


class Slide(NamedTuple):
    """The slide: its own mass has weight, the reflected mass of its drive only inertia."""

    mass_kg: float
    drive_mass_kg: float


class Spring(NamedTuple):
    """A linear spring at a driven coordinate: N m/rad, rad or N/m, m."""

    stiffness_si: float = 0.0
    rest_si: float = 0.0


class Dampers(NamedTuple):
    """Viscous dampers of the joints, in N m s/rad."""

    hip: Viscosity = 0.0
    knee: Viscosity = 0.0
    ankle: Viscosity = 0.0
    slide_joint: Viscosity = 0.0


class LegParameters(NamedTuple):
    """One leg in the form that the kernels of `mechanism.py` take; made by `leg_parameters`.

    With K the vector hip to knee, u knee to ankle, w slide joint to ankle (complex numbers), the
    centres of mass are c1 K, K + c2 u and K + u - c3 w. Kinetic energy, potential energy and bias
    forces then need the masses only in the sums below.
    """

    thigh_length_m: float
    shank_length_m: float
    shoe_length_m: float
    thigh_angle_rad: float
    """Angle of the thigh's line in the world at hip angle 0."""
    rail_x_m: float
    rail_y_m: float
    rail_cos: Number
    rail_sin: Number
    thigh_inertia: Inertia
    """J1 + m1 |c1|^2 l1^2 + (m2 + m3) l1^2 + the hip drive's reflected inertia, kg m^2."""
    shank_inertia: Inertia
    """J2 + m2 |c2|^2 l2^2 + m3 l2^2, kg m^2."""
    shoe_inertia: Inertia
    """J3 + m3 |c3|^2 l3^2, kg m^2."""
    slide_inertia: Inertia
    """Slide and its drive's reflected mass, kg."""
    thigh_moment_re: Mass
    thigh_moment_im: Mass
    """m1 c1 + m2 + m3, kg."""
    shank_moment_re: Mass
    shank_moment_im: Mass
    """m2 c2 + m3, kg."""
    shoe_moment_re: Mass
    shoe_moment_im: Mass
    """m3 c3, kg."""
    slide_weight_n: float
    """Weight of the slide's own mass along the rail."""
    hip_stiffness: Stiffness
    hip_rest_rad: float
    slide_stiffness: Stiffness
    slide_rest_m: float
    hip_damping: Viscosity
    knee_damping: Viscosity
    ankle_damping: Viscosity
    slide_joint_damping: Viscosity
    smallest_delta: Area
    """SMALLEST_RATIO * shank length * shoe length, m^2."""


def leg_parameters(
    geometry: Geometry,
    links: tuple[Link, Link, Link],
    slide: Slide,
    hip_drive_inertia_kg_m2: float,
    springs: tuple[Spring, Spring],
    dampers: Dampers,
) -> LegParameters:
    """Compose the parameters for the kernels.

    Args:
        geometry: lengths, recline and rail.
        links: thigh, shank and shoe; with a patient in the machine those of `with_patient`.
        slide: the slide and its drive's reflected mass.
        hip_drive_inertia_kg_m2: the hip drive's inertia, reflected to the joint.
        springs: springs at hip and slide.
        dampers: dampers of the four joints.
    """
    l1, l2, l3 = geometry.thigh_length_m, geometry.shank_length_m, geometry.shoe_length_m
    thigh, shank, shoe = links
    hip_spring, slide_spring = springs
    c1, c2, c3 = (cmath.rect(link.com_ratio, link.com_offset_rad) for link in links)
    thigh_moment = thigh.mass_kg * c1 + shank.mass_kg + shoe.mass_kg
    shank_moment = shank.mass_kg * c2 + shoe.mass_kg
    shoe_moment = shoe.mass_kg * c3
    composed = LegParameters(
        thigh_length_m=l1,
        shank_length_m=l2,
        shoe_length_m=l3,
        thigh_angle_rad=-math.pi / 2 + geometry.recline_rad + geometry.thigh_offset_rad,
        rail_x_m=geometry.rail_x_m,
        rail_y_m=geometry.rail_y_m,
        rail_cos=math.cos(geometry.rail_angle_rad),
        rail_sin=math.sin(geometry.rail_angle_rad),
        thigh_inertia=_about_joint(thigh, l1)
        + (shank.mass_kg + shoe.mass_kg) * l1**2
        + hip_drive_inertia_kg_m2,
        shank_inertia=_about_joint(shank, l2) + shoe.mass_kg * l2**2,
        shoe_inertia=_about_joint(shoe, l3),
        slide_inertia=slide.mass_kg + slide.drive_mass_kg,
        thigh_moment_re=thigh_moment.real,
        thigh_moment_im=thigh_moment.imag,
        shank_moment_re=shank_moment.real,
        shank_moment_im=shank_moment.imag,
        shoe_moment_re=shoe_moment.real,
        shoe_moment_im=shoe_moment.imag,
        slide_weight_n=slide.mass_kg * GRAVITY * math.sin(geometry.rail_angle_rad),
        hip_stiffness=hip_spring.stiffness_si,
        hip_rest_rad=hip_spring.rest_si,
        slide_stiffness=slide_spring.stiffness_si,
        slide_rest_m=slide_spring.rest_si,
        hip_damping=dampers.hip,
        knee_damping=dampers.knee,
        ankle_damping=dampers.ankle,
        slide_joint_damping=dampers.slide_joint,
        smallest_delta=SMALLEST_RATIO * l2 * l3,
    )
    return LegParameters._make(map(float, composed))  # an int would be another type for numba


def _about_joint(link: Link, length_m: float) -> float:
    return link.inertia_kg_m2 + link.mass_kg * (link.com_ratio * length_m) ** 2


class BodySegment(NamedTuple):
    """One segment of the human leg, as fractions of body mass, height and segment length."""

    mass_per_body_mass: Number
    length_per_height: Number
    com_ratio: float
    com_offset_rad: float
    gyration_ratio: float
    """Radius of gyration about the centre of mass, in segment lengths."""


THIGH: Final = BodySegment(0.100, 0.245, 0.433, 0.0, 0.323)
SHANK: Final = BodySegment(0.0465, 0.246, 0.433, 0.0, 0.302)
FOOT: Final = BodySegment(0.0145, 0.152, 0.35, math.radians(-10.0), 0.475)
"""Winter 2009, table 4.1 (mass, centre of mass, gyration; lengths after Drillis and Contini). The
foot's centre of mass is placed in the shoe link: 0.35 of its length, 10 degrees below its line."""
BODY: Final = (THIGH, SHANK, FOOT)


def with_patient(
    links: tuple[Link, Link, Link],
    geometry: Geometry,
    mass_kg: float,
    height_m: float,
    body: tuple[BodySegment, BodySegment, BodySegment] = BODY,
) -> tuple[Link, Link, Link]:
    """Thigh, shank and shoe of the machine together with the patient's leg in it.

    Args:
        links: the machine's own links.
        geometry: its lengths; the patient's joints are at the machine's joints.
        mass_kg: whole body mass.
        height_m: whole body height.
        body: thigh, shank and foot.

    Source: Winter, Biomechanics and Motor Control of Human Movement, 2009, table 4.1.
    """
    lengths_m = (geometry.thigh_length_m, geometry.shank_length_m, geometry.shoe_length_m)
    thigh, shank, shoe = (
        _combined(link, _of_body(segment, mass_kg, height_m), length_m)
        for link, segment, length_m in zip(links, body, lengths_m, strict=True)
    )
    return thigh, shank, shoe


def _of_body(segment: BodySegment, mass_kg: float, height_m: float) -> Link:
    mass = segment.mass_per_body_mass * mass_kg
    gyration_m = segment.gyration_ratio * segment.length_per_height * height_m
    return Link(mass, segment.com_ratio, segment.com_offset_rad, mass * gyration_m**2)


def _combined(one: Link, other: Link, length_m: float) -> Link:
    """Combine two rigid bodies on the same link into one (parallel axis theorem)."""
    mass = one.mass_kg + other.mass_kg
    com_one = cmath.rect(one.com_ratio, one.com_offset_rad)
    com_other = cmath.rect(other.com_ratio, other.com_offset_rad)
    com = (one.mass_kg * com_one + other.mass_kg * com_other) / mass
    inertia = one.inertia_kg_m2 + one.mass_kg * (abs(com_one - com) * length_m) ** 2
    inertia += other.inertia_kg_m2 + other.mass_kg * (abs(com_other - com) * length_m) ** 2
    return Link(mass, abs(com), cmath.phase(com), inertia)
