"""An independent derivation of the mechanism: law of cosines, Lagrangian, automatic derivatives.

Nothing here is the observer's: the ankle comes from triangle angles, energies from the links' own
masses and centres of mass, and the equations of motion from CasADi's derivatives of the Lagrangian.
"""

import casadi as ca
import numpy as np

from observer.mechanism.parameters import Dampers, Geometry, Link, Slide, Spring

GRAVITY = 9.81


def build(
    geometry: Geometry,
    links: tuple[Link, Link, Link],
    slide: Slide,
    drive_inertia: float,
    springs: tuple[Spring, Spring],
    dampers: Dampers,
) -> ca.Function:
    """(q, q', effort) -> ankle, M (2x2), g, C~ q', c, q'', T, V, and det of the loop's Jacobian."""
    q, v, effort = ca.SX.sym("q", 2), ca.SX.sym("v", 2), ca.SX.sym("u", 2)
    l1, l2, l3 = geometry.thigh_length_m, geometry.shank_length_m, geometry.shoe_length_m

    def along(angle):
        return ca.vertcat(ca.cos(angle), ca.sin(angle))

    thigh_angle = -ca.pi / 2 + geometry.recline_rad + geometry.thigh_offset_rad + q[0]
    knee = l1 * along(thigh_angle)
    rail = along(geometry.rail_angle_rad)
    joint = ca.vertcat(geometry.rail_x_m, geometry.rail_y_m) + q[1] * rail
    reach = joint - knee
    distance = ca.norm_2(reach)
    # Triangle knee, slide joint, ankle: the angle at the knee by the law of cosines.
    at_knee = ca.acos((l2**2 + distance**2 - l3**2) / (2 * l2 * distance))
    shank_angle = ca.atan2(reach[1], reach[0]) - at_knee
    ankle = knee + l2 * along(shank_angle)
    to_joint = joint - ankle
    shoe_angle = ca.atan2(to_joint[1], to_joint[0])
    angles = ca.vertcat(thigh_angle, shank_angle, shoe_angle)

    kinetic = 0.5 * drive_inertia * v[0] ** 2
    kinetic += 0.5 * (slide.mass_kg + slide.drive_mass_kg) * v[1] ** 2
    potential = GRAVITY * slide.mass_kg * joint[1]
    origins, lengths = (ca.SX.zeros(2), knee, ankle), (l1, l2, l3)
    for link, origin, length, angle in zip(
        links, origins, lengths, ca.vertsplit(angles), strict=True
    ):
        com = origin + link.com_ratio * length * along(angle + link.com_offset_rad)
        velocity = ca.jtimes(com, q, v)
        rate = ca.jtimes(angle, q, v)
        kinetic += 0.5 * link.mass_kg * ca.dot(velocity, velocity)
        kinetic += 0.5 * link.inertia_kg_m2 * rate**2
        potential += GRAVITY * link.mass_kg * com[1]
    for axis, spring in enumerate(springs):
        potential += 0.5 * spring.stiffness_si * (q[axis] - spring.rest_si) ** 2

    rates = ca.jtimes(angles, q, v)
    loss = 0.5 * (
        dampers.hip * v[0] ** 2
        + dampers.knee * (rates[1] - rates[0]) ** 2
        + dampers.ankle * (rates[2] - rates[1]) ** 2
        + dampers.slide_joint * rates[2] ** 2
    )
    mass, _ = ca.hessian(kinetic, v)
    weight = ca.gradient(potential, q)
    damping = ca.gradient(loss, v)
    momentum = ca.gradient(kinetic, v)
    coriolis = ca.jtimes(momentum, q, v) - ca.gradient(kinetic, q)
    acceleration = ca.solve(mass, effort - coriolis - damping - weight)
    return ca.Function(
        "leg",
        [q, v, effort],
        [ankle, mass, weight, damping, coriolis, acceleration, kinetic, potential],
    )


class Reference:
    """The derivation at many states at once."""

    def __init__(self, *physics):
        self.function = build(*physics)

    def __call__(self, q, v, effort):
        """All of (n, 2); a dictionary of arrays with n rows."""
        names = ("ankle", "mass", "weight", "damping", "coriolis", "acceleration", "T", "V")
        values = self.function.map(len(q))(q.T, v.T, effort.T)
        columns = {name: np.asarray(value).T for name, value in zip(names, values, strict=True)}
        columns["mass"] = columns["mass"].reshape(len(q), 2, 2)
        return columns
