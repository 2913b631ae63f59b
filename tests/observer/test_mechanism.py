"""The closed form of the leg against numbers of others, another derivation, and laws of physics."""

import cmath
import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.jit import kernel
from observer.mechanism.linkage import bounded_acceleration, pose, rates
from observer.mechanism.mechanism import (
    WorkspaceError,
    gravity,
    knee_angle,
    mass_matrix,
    ratio_and_load,
    singularity_ratio,
    slide_position_for_knee,
    smallest_inertia,
)
from observer.mechanism.parameters import (
    Dampers,
    Geometry,
    Link,
    Slide,
    Spring,
    leg_parameters,
    with_patient,
)
from tests.observer.mechanics import (
    acceleration,
    closes,
    coriolis,
    damping,
    joint_positions,
    kinetic_energy,
    potential_energy,
)
from tests.observer.trainer import (
    DAMPERS,
    EXOSKELETON,
    GEOMETRY,
    HIP_DRIVE_INERTIA,
    PATIENT,
    PROTOTYPE,
    SLIDE,
    gait,
)

# The rail's origin and the poses before they were rounded for print (observer.md 2.4 and 2.6).
RAIL = complex(-0.30, -0.88) * cmath.exp(1j * GEOMETRY.recline_rad)
EXACT = GEOMETRY._replace(rail_x_m=RAIL.real, rail_y_m=RAIL.imag)
LINKS = with_patient(EXOSKELETON, EXACT, 80.0, 1.78)
SPRINGS = (Spring(20.0, 2.0), Spring(120.0, 1.2))
GOLDEN_LEG = leg_parameters(EXACT, LINKS, SLIDE, HIP_DRIVE_INERTIA, SPRINGS, DAMPERS)
EFFORT = np.array([20.0, 80.0])
ZERO = np.zeros(2)
PRINTED = 1e-10
"""Golden vectors have ten decimals."""
GOLDEN = (
    {
        "q": (math.radians(12.0), 0.5),
        "dq": (1.1, -0.7),
        "ankle": (0.7058063866, -0.4619142934),
        "delta": -0.1079221547,
        "mass": (1.7636329928, 0.2896938494, 15.7769169100),
        "gravity": (7.665372744, -2.4863927461),
        "damping": (3.0810460911, -3.2828324494),
        "coriolis": (4.230034718, 2.5269424867),
        "kinetic": 4.7092783396,
        "potential": 12.1409800377,
        "acceleration": (1.9877350282, 5.2397086559),
    },
    {
        "q": (math.radians(-8.0), 0.2),
        "dq": (-2.0, 0.9),
        "ankle": (0.5098791164, -0.6735915252),
        "mass": (1.7470157654, 0.2215130928, 14.9960183514),
        "coriolis": (9.9473564446, 10.7521369115),
        "acceleration": (9.6035615215, 7.7495629266),
    },
    {
        "q": (math.radians(30.0), 0.9),
        "dq": (0.5, 1.5),
        "mass": (1.5874801756, 0.8910518630, 18.6418939404),
        "coriolis": (8.6419633891, 47.8895988852),
        "acceleration": (2.9406436798, -3.2348050975),
    },
)
GOLDEN_FUNCTIONS = {
    "ankle": lambda q, dq: joint_positions(GOLDEN_LEG, q)[2],
    "delta": lambda q, dq: pose_of(GOLDEN_LEG, q[0], q[1]).delta,
    "mass": lambda q, dq: mass_matrix(GOLDEN_LEG, q)[[0, 0, 1], [0, 1, 1]],
    "gravity": lambda q, dq: gravity(GOLDEN_LEG, q),
    "damping": lambda q, dq: damping(GOLDEN_LEG, q, dq),
    "coriolis": lambda q, dq: coriolis(GOLDEN_LEG, q, dq),
    "kinetic": lambda q, dq: kinetic_energy(GOLDEN_LEG, q, dq),
    "potential": lambda q, dq: potential_energy(GOLDEN_LEG, q),
    "acceleration": lambda q, dq: acceleration(GOLDEN_LEG, q, dq, EFFORT, ZERO, True),
}


@kernel
def pose_of(p, hip, slide):
    return pose(p, hip, slide)


@kernel
def rates_of(p, hip, slide):
    return rates(p, pose(p, hip, slide))


@pytest.mark.parametrize(
    ("vector", "name"), [(v, name) for v in GOLDEN for name in v if name in GOLDEN_FUNCTIONS]
)
def test_golden_vectors_are_met_in_every_digit(vector, name):
    value = GOLDEN_FUNCTIONS[name](np.array(vector["q"]), np.array(vector["dq"]))

    np.testing.assert_allclose(value, vector[name], rtol=0, atol=PRINTED)


@pytest.mark.parametrize(
    ("link", "expected"),
    list(
        zip(
            LINKS,
            (
                (12.0, 0.438426153, 0.023868249, 0.227826954),
                (6.22, 0.459498474, -0.038127365, 0.109953498),
                (4.16, 0.447764659, 0.239867432, 0.052787001),
            ),
            strict=True,
        )
    ),
)
def test_a_patients_leg_joins_the_machines_links_as_in_the_golden_vectors(link, expected):
    np.testing.assert_allclose(link, expected, rtol=0, atol=6e-10)


def test_in_a_weightless_machine_hangs_winters_leg():
    weightless = (Link(0.0, 0.3, 0.5, 0.0),) * 3

    thigh, shank, foot = with_patient(weightless, EXACT, 80.0, 1.78)

    assert thigh[:3] == pytest.approx((8.0, 0.433, 0.0), abs=1e-14)
    assert shank[:3] == pytest.approx((3.72, 0.433, 0.0), abs=1e-14)
    assert foot[:3] == pytest.approx((1.16, 0.35, math.radians(-10.0)), abs=1e-14)
    assert thigh.inertia_kg_m2 == pytest.approx(8.0 * (0.323 * 0.245 * 1.78) ** 2)
    assert shank.inertia_kg_m2 == pytest.approx(3.72 * (0.302 * 0.246 * 1.78) ** 2)
    assert foot.inertia_kg_m2 == pytest.approx(1.16 * (0.475 * 0.152 * 1.78) ** 2)


# An independent derivation of the mechanism: law of cosines, Lagrangian, automatic derivatives.
# Nothing in it is the observer's: the ankle comes from triangle angles, energies from the links'
# own masses and centres of mass, and the equations of motion from CasADi's derivatives of the
# Lagrangian.
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


def random_states(count, seed, least_ratio=0.3):
    """q, q' where the leg closes, well off the singularity."""
    random = np.random.default_rng(seed)
    chosen = []
    while len(chosen) < count:
        q = np.array([random.uniform(-0.35, 0.7), random.uniform(0.0, 1.0)])
        if singularity_ratio(GOLDEN_LEG, q) > least_ratio:
            chosen.append(q)
    return np.array(chosen), random.uniform(-2.5, 2.5, (count, 2))


QS, DQS = random_states(2000, 7)
PHYSICS = (EXACT, LINKS, SLIDE, HIP_DRIVE_INERTIA, SPRINGS, DAMPERS)


@pytest.fixture(scope="module")
def derived():
    return Reference(*PHYSICS)(QS, DQS, np.tile(EFFORT, (len(QS), 1)))


@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("ankle", lambda q, dq: joint_positions(GOLDEN_LEG, q)[2]),
        ("mass", lambda q, dq: mass_matrix(GOLDEN_LEG, q)),
        ("weight", lambda q, dq: gravity(GOLDEN_LEG, q)),
        ("damping", lambda q, dq: damping(GOLDEN_LEG, q, dq)),
        ("coriolis", lambda q, dq: coriolis(GOLDEN_LEG, q, dq)),
        ("acceleration", lambda q, dq: acceleration(GOLDEN_LEG, q, dq, EFFORT, ZERO, True)),
        ("T", lambda q, dq: np.array([kinetic_energy(GOLDEN_LEG, q, dq)])),
    ],
)
def test_the_closed_form_is_the_derivative_of_the_lagrangian(derived, name, function):
    ours = np.array([function(q, dq) for q, dq in zip(QS, DQS, strict=True)])

    scale = np.abs(derived[name]).max()
    np.testing.assert_allclose(ours, derived[name], rtol=1e-12, atol=1e-12 * scale)


def test_potential_energy_differs_from_the_derivation_by_no_more_than_its_zero(derived):
    ours = np.array([potential_energy(GOLDEN_LEG, q) for q in QS])

    np.testing.assert_allclose(ours - derived["V"][:, 0], 0.0, atol=1e-12 * 100)


@pytest.mark.parametrize("name", ["thigh", "shank", "shoe", "offset"])
def test_other_legs_than_the_golden_one_agree_with_the_derivation_too(name):
    """Every parameter moves: lengths, offsets, angles, inertias, dampers, springs."""
    random = np.random.default_rng(len(name))
    geometry = EXACT._replace(
        thigh_length_m=0.40,
        shank_length_m=0.45,
        shoe_length_m=0.22,
        recline_rad=0.9,
        rail_angle_rad=1.1,
        thigh_offset_rad=0.05 if name == "offset" else -0.02,
    )
    links = tuple(
        Link(
            *(
                random.uniform(low, high)
                for low, high in ((1, 9), (0.2, 0.7), (-0.6, 0.6), (0.01, 0.3))
            )
        )
        for _ in range(3)
    )
    physics = (
        geometry,
        links,
        Slide(2.0, 9.0),
        0.2,
        (Spring(35.0, -0.4), Spring(90.0, 0.3)),
        Dampers(0.1, 0.7, 0.2, 0.9),
    )
    leg = leg_parameters(*physics)
    q = np.array([[0.1, 0.45], [0.3, 0.5], [0.0, 0.3]])
    dq = random.uniform(-2, 2, (3, 2))

    reference = Reference(*physics)(q, dq, np.zeros((3, 2)))
    ours = [acceleration(leg, a, b, ZERO, ZERO, True) for a, b in zip(q, dq, strict=True)]

    np.testing.assert_allclose(ours, reference["acceleration"], rtol=1e-11)


def test_the_mass_matrix_is_symmetric_and_positive_definite_wherever_the_leg_closes():
    grid = [
        np.array([hip, slide])
        for hip in np.linspace(-0.349, 0.698, 61)
        for slide in np.linspace(0.0, 1.0, 101)
    ]
    reachable = [q for q in grid if closes(GOLDEN_LEG, *q)]
    eigenvalues = np.array([np.linalg.eigvalsh(mass_matrix(GOLDEN_LEG, q)) for q in reachable])

    assert len(reachable) / len(grid) == pytest.approx(0.85, abs=0.02)
    assert eigenvalues.min() > 1.42  # kg m^2; 1.43 in observer.md 2.5
    well = np.array([singularity_ratio(GOLDEN_LEG, q) > 0.3 for q in reachable])
    assert (eigenvalues[well, 1] / eigenvalues[well, 0]).max() < 40.0


def test_least_effective_inertias_are_those_of_the_grid():
    hip, slide = smallest_inertia(GOLDEN_LEG, 0.3)

    assert hip == pytest.approx(1.43, abs=0.01)
    assert 11.0 < slide < 12.7
    assert smallest_inertia(PROTOTYPE, 0.3)[0] == pytest.approx(0.72, abs=0.01)


def test_jacobians_are_the_differences_of_positions():
    """Turn rates of shank and shoe against central differences of their directions."""
    step = 1e-6
    for q in QS[:200]:
        w = rates_of(GOLDEN_LEG, *q)
        for axis, (shank, shoe) in enumerate(
            ((w.shank_hip, w.shoe_hip), (w.shank_slide, w.shoe_slide))
        ):
            change = np.zeros(2)
            change[axis] = step
            ahead, behind = pose_of(GOLDEN_LEG, *(q + change)), pose_of(GOLDEN_LEG, *(q - change))
            turned = [
                cmath.phase(complex(*a) / complex(*b)) / (2 * step)
                for a, b in zip(directions(ahead), directions(behind), strict=True)
            ]
            assert turned == pytest.approx([shank, shoe], abs=1e-8 * 10)


def directions(at):
    return (at.shank_x, at.shank_y), (at.shoe_x, at.shoe_y)


def test_power_into_the_leg_is_the_growth_of_its_kinetic_energy():
    """The skew property: dT/dt = q' (u - g - C~ q') whatever the Coriolis terms do."""
    for q, dq in zip(QS[:300], DQS[:300], strict=True):
        a = acceleration(GOLDEN_LEG, q, dq, EFFORT, ZERO, True)
        step = 1e-6
        growth = (
            kinetic_energy(GOLDEN_LEG, q + step * dq, dq + step * a)
            - kinetic_energy(GOLDEN_LEG, q - step * dq, dq - step * a)
        ) / (2 * step)
        power = dq @ (EFFORT - gravity(GOLDEN_LEG, q) - damping(GOLDEN_LEG, q, dq))

        assert growth == pytest.approx(power, abs=1e-7 * max(1.0, np.abs(dq).max() * 500.0))


@kernel
def swing(p, q1, q2, steps, dt, coriolis_share):
    """RK4 without effort from rest; largest |v| on the way, and the state at the end."""
    v1 = v2 = 0.0
    for _ in range(steps):
        a1, a2, _ = bounded_acceleration(p, q1, q2, v1, v2, 0.0, 0.0, coriolis_share)
        b1, b2, _ = bounded_acceleration(
            p,
            q1 + dt / 2 * v1,
            q2 + dt / 2 * v2,
            v1 + dt / 2 * a1,
            v2 + dt / 2 * a2,
            0.0,
            0.0,
            coriolis_share,
        )
        c1, c2, _ = bounded_acceleration(
            p,
            q1 + dt / 2 * (v1 + dt / 2 * a1),
            q2 + dt / 2 * (v2 + dt / 2 * a2),
            v1 + dt / 2 * b1,
            v2 + dt / 2 * b2,
            0.0,
            0.0,
            coriolis_share,
        )
        d1, d2, _ = bounded_acceleration(
            p,
            q1 + dt * (v1 + dt / 2 * b1),
            q2 + dt * (v2 + dt / 2 * b2),
            v1 + dt * c1,
            v2 + dt * c2,
            0.0,
            0.0,
            coriolis_share,
        )
        q1 += dt * v1 + dt * dt / 6 * (a1 + b1 + c1)
        q2 += dt * v2 + dt * dt / 6 * (a2 + b2 + c2)
        v1 += dt / 6 * (a1 + 2 * b1 + 2 * c1 + d1)
        v2 += dt / 6 * (a2 + 2 * b2 + 2 * c2 + d2)
    return q1, q2, v1, v2


UNDAMPED = leg_parameters(
    EXACT, LINKS, SLIDE, HIP_DRIVE_INERTIA, (Spring(60.0, 0.9), Spring(400.0, 0.75)), Dampers()
)


def energy_change(leg, coriolis_share):
    q1, q2, v1, v2 = swing(leg, 0.15, 0.50, 4000, 1e-3, coriolis_share)
    q, dq = np.array([q1, q2]), np.array([v1, v2])
    end = kinetic_energy(leg, q, dq) + potential_energy(leg, q)
    return end - potential_energy(leg, np.array([0.15, 0.50]))


def test_a_swing_without_dampers_keeps_its_energy():
    assert abs(energy_change(UNDAMPED, 1.0)) <= 1e-6  # J in 4 s


def test_the_papers_model_without_coriolis_does_not_keep_it():
    assert abs(energy_change(UNDAMPED, 0.0)) >= 1e-3


def test_dampers_only_take_energy_and_none_without_damping():
    for q, dq in zip(QS[:500], DQS[:500], strict=True):
        assert dq @ damping(GOLDEN_LEG, q, dq) > 0.0
        np.testing.assert_array_equal(damping(UNDAMPED, q, dq), 0.0)


def test_the_damping_matrix_is_symmetric_and_not_negative():
    for q in QS[:300]:
        columns = [damping(GOLDEN_LEG, q, unit) for unit in np.eye(2)]
        matrix = np.array(columns)

        assert matrix[0, 1] == pytest.approx(matrix[1, 0], abs=1e-13)
        assert np.linalg.eigvalsh(matrix).min() >= 0.0


def test_the_ankle_stays_on_its_branch_wherever_the_leg_may_go():
    """Half a millimetre of slide moves the ankle by 1.43 mm at most, and Delta keeps its sign."""
    worst = 0.0
    for hip in np.linspace(math.radians(-20.0), math.radians(40.0), 61):
        before = None
        for slide in np.arange(0.0, 1.0, 0.0005):
            at = pose_of(GOLDEN_LEG, hip, slide)
            ratio = -at.delta / (0.43788 * 0.25)
            now = complex(at.knee_x + at.shank_x, at.knee_y + at.shank_y)
            if not (at.closes and ratio > 0.3):
                before = None
                continue
            assert at.delta < 0.0
            # The other branch mirrors the ankle at the line from knee to slide joint.
            reach = abs(complex(at.shank_x - at.shoe_x, at.shank_y - at.shoe_y))
            assert 2.0 * -at.delta / reach > 0.096
            worst = worst if before is None else max(worst, abs(now - before))
            before = now

    assert worst <= 1.44e-3


def test_ratio_and_load_of_one_call_are_those_of_two():
    for q in QS[:200]:
        ratio, hip_nm, slide_n = ratio_and_load(GOLDEN_LEG, *q)

        assert ratio == singularity_ratio(GOLDEN_LEG, q)
        assert (hip_nm, slide_n) == tuple(gravity(GOLDEN_LEG, q))
    for beyond in ((math.radians(-20.0), 0.9), (math.nan, 0.5), (0.2, math.nan), (0.2, math.inf)):
        assert ratio_and_load(GOLDEN_LEG, *beyond) == (0.0, 0.0, 0.0)


def test_where_the_circles_do_not_meet_every_function_says_so():
    beyond = np.array([math.radians(-20.0), 0.9])

    assert not closes(GOLDEN_LEG, *beyond)
    assert singularity_ratio(GOLDEN_LEG, beyond) == 0.0
    for function in (
        lambda: gravity(GOLDEN_LEG, beyond),
        lambda: mass_matrix(GOLDEN_LEG, beyond),
        lambda: coriolis(GOLDEN_LEG, beyond, ZERO),
        lambda: damping(GOLDEN_LEG, beyond, ZERO),
        lambda: acceleration(GOLDEN_LEG, beyond, ZERO, EFFORT, ZERO, True),
        lambda: joint_positions(GOLDEN_LEG, beyond),
        lambda: knee_angle(GOLDEN_LEG, beyond),
        lambda: kinetic_energy(GOLDEN_LEG, beyond, ZERO),
        lambda: potential_energy(GOLDEN_LEG, beyond),
        lambda: slide_position_for_knee(GOLDEN_LEG, 0.2, 3.0),
    ):
        with pytest.raises(WorkspaceError):
            function()


@given(
    hip=st.floats(-3.0, 3.0),
    slide=st.floats(-3.0, 3.0),
    v1=st.floats(-50.0, 50.0),
    v2=st.floats(-50.0, 50.0),
)
@settings(derandomize=True, max_examples=400, deadline=None)
def test_the_bounded_acceleration_is_finite_everywhere(hip, slide, v1, v2):
    a1, a2, inside = bounded_acceleration(GOLDEN_LEG, hip, slide, v1, v2, 20.0, 80.0, 1.0)

    assert math.isfinite(a1)
    assert math.isfinite(a2)
    assert inside == closes(GOLDEN_LEG, hip, slide)


def test_the_bounded_acceleration_is_the_acceleration_inside():
    for q, dq in zip(QS[:200], DQS[:200], strict=True):
        a1, a2, inside = bounded_acceleration(GOLDEN_LEG, *q, *dq, *EFFORT, 1.0)

        assert inside
        np.testing.assert_array_equal((a1, a2), acceleration(GOLDEN_LEG, q, dq, EFFORT, ZERO, True))


def test_the_leg_plays_the_normative_gait_with_hip_and_knee_exact():
    phase = np.linspace(0.0, 1.0, 201)
    path = gait(PATIENT, phase, 1.0)
    knee = np.array([knee_angle(PATIENT, q) for q in path])
    back = [slide_position_for_knee(PATIENT, *pair) for pair in zip(path[:, 0], knee, strict=True)]

    np.testing.assert_allclose(back, path[:, 1], atol=1e-14)
    assert path[:, 1].min() == pytest.approx(0.053, abs=1e-3)
    assert path[:, 1].max() == pytest.approx(0.931, abs=1e-3)
    assert knee.min() >= 0.0
    assert min(singularity_ratio(PATIENT, q) for q in path) == pytest.approx(0.640, abs=2e-3)


def test_coriolis_along_the_gait_is_as_large_as_the_reference_says():
    """observer.md 2.5: at 0.25 Hz 0.98 N m and 0.94 N rms; grows with the square of cadence."""
    time_s = np.linspace(0.0, 4.0, 801)
    path = gait(PATIENT, time_s, 0.25)
    speed = np.gradient(path, time_s, axis=0)
    c = np.array([coriolis(PATIENT, q, dq) for q, dq in zip(path, speed, strict=True)])

    assert np.sqrt(np.mean(c**2, axis=0)) == pytest.approx((0.98, 0.94), rel=0.03)
