"""Quantities to calibrate: their keys in robot.toml, and transformed values suited to a search.

A search uses `free` numbers: logarithms of positive values, the Stribeck hump instead of the peak
of the law, in parts of the Coulomb level (so that the law stays valid), and springs by stiffness
and by their effort at a pose in the middle of the recording (so that the two are nearly
independent).

An axis whose file says stiffness 0 has no spring, and gets none. Only such an axis shows the offset
of its drive's effort: beside a spring, an offset and another rest are the same effort everywhere.
"""

from dataclasses import dataclass
from operator import attrgetter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.config.robot import friction_over_position, friction_parameters, leg_parameters
from daemon.config.settings import Robot
from observer.filter.leg_model import LegModel
from observer.mechanism.friction import FrictionParameters, OverPosition, smallest_stribeck
from observer.mechanism.parameters import LegParameters
from observer.quantities import Number

Vector = NDArray[np.float64]
AXES: Final = ("hip", "slide")


class Quantity(NamedTuple):
    """One number of robot.toml that a recording may identify."""

    key: str
    """Dotted key."""
    label: str
    unit: str
    axis: int
    is_friction: bool = False


_LAW: Final = (
    *("coulomb", "stribeck", "viscous", "transition", "peak", "edge", "time constant"),
    *("bristle stiffness", "bristle damping"),
)


def _of_axis(axis: int, names: tuple[str, ...], units: tuple[str, ...]) -> list[Quantity]:
    table = f"friction.{AXES[axis]}"
    return [
        Quantity(f"{table}.{name}", f"{AXES[axis]} {label}", unit, axis, is_friction=True)
        for name, label, unit in zip(names, _LAW, units, strict=True)
    ]


QUANTITIES: Final = (
    *_of_axis(
        0,
        (
            *("coulomb_nm", "stribeck_nm", "viscous_nm_s_per_rad", "transition_rad_per_s"),
            *("peak_rad_per_s", "edge_rad_per_s", "time_constant_s"),
            *("bristle_stiffness_nm_per_rad", "bristle_damping_nm_s_per_rad"),
        ),
        (
            *("N·m", "N·m", "N·m s/rad", "rad/s", "rad/s", "rad/s", "s"),
            *("N·m/rad", "N·m s/rad"),
        ),
    ),
    *_of_axis(
        1,
        (
            *("coulomb_n", "stribeck_n", "viscous_n_s_per_m", "transition_m_per_s"),
            *("peak_m_per_s", "edge_m_per_s", "time_constant_s"),
            *("bristle_stiffness_n_per_m", "bristle_damping_n_s_per_m"),
        ),
        ("N", "N", "N s/m", "m/s", "m/s", "m/s", "s", "N/m", "N s/m"),
    ),
    Quantity("springs.hip.stiffness_nm_per_rad", "hip spring stiffness", "N·m/rad", 0),
    Quantity("springs.hip.rest_rad", "hip spring rest", "rad", 0),
    Quantity("hip.drive_inertia_kg_m2", "hip drive inertia", "kg m²", 0),
    Quantity("springs.slide.stiffness_n_per_m", "slide spring stiffness", "N/m", 1),
    Quantity("springs.slide.rest_m", "slide spring rest", "m", 1),
    Quantity("slide.drive_mass_kg", "slide drive mass", "kg", 1),
    Quantity("friction_over_position.hip.slope_per_rad", "hip friction slope", "1/rad", 0),
    Quantity("effort_offset.hip.torque_nm", "hip effort offset", "N·m", 0),
    Quantity("friction_over_position.slide.slope_per_m", "slide friction slope", "1/m", 1),
    Quantity("effort_offset.slide.force_n", "slide effort offset", "N", 1),
    Quantity("observer.hip.measurement_angle_rad", "hip encoder noise", "rad", 0),
    Quantity("observer.slide.measurement_position_m", "slide encoder noise", "m", 1),
)
"""Order of every vector of natural values; NUISANCES more numbers follow."""
COUNT: Final = len(QUANTITIES)
LAW_SIZE: Final = len(_LAW)
OF_LAW_11: Final = slice(3, 7)
"""Transition, peak, edge and time constant, within a law."""
PEAK: Final = 4
BRISTLES: Final = slice(7, LAW_SIZE)
"""Stiffness and damping, within a law; both 0 without bristles."""
SPRINGS: Final = 2 * LAW_SIZE
"""Start of the springs and inertias, three for each axis."""
OVER: Final = SPRINGS + 6
SLOPES: Final = (OVER, OVER + 2)
"""Friction over position, by axis."""
OFFSETS: Final = (OVER + 1, OVER + 3)
"""Efforts that the drives show at none, by axis."""
CANDIDATES: Final = (*SLOPES, *OFFSETS)
"""Few machines have them: they keep the file's values unless the recording says otherwise."""
NOISE: Final = OVER + 4
NUISANCES: Final = 6
"""Effort noise, friction noise and timing, hip and slide: estimated, never written. Timing is how
much later an effort acts than its row and the file's `effort_delay_ms` say, s."""
SIZE: Final = COUNT + NUISANCES
TIMING: Final = SIZE - 2
TIMING_S: Final = 1e-3
"""Step of timing comparable to a free step of 1 elsewhere."""
KEYS: Final = tuple(quantity.key for quantity in QUANTITIES)
BRISTLE_KEYS: Final = KEYS[:LAW_SIZE][BRISTLES], KEYS[LAW_SIZE:SPRINGS][BRISTLES]
"""By axis."""
SPRING_SCALE: Final = ((20.0, 5.0, 0.2), (100.0, 30.0, 4.0))
"""Steps of stiffness, effort and inertia comparable to a free step of 1 elsewhere."""
SLOPE_SCALE: Final = 0.6
"""The same of a slope, 1/rad or 1/m: a machine that was not measured may have half of it."""
SMALLEST: Final = 1e-9
HUMP_MIN_RATIO: Final = 1e-3
"""Over the Coulomb level: initial hump of a law given without one."""


def value_of(robot: Robot, key: str) -> float:
    """Value of a robot's dotted key."""
    return float(attrgetter(key)(robot))


def natural_values(robot: Robot) -> Vector:
    """Values of the file, and nuisances as small parts of the Coulomb level; shape (SIZE,)."""
    values = [value_of(robot, key) for key in KEYS]
    hip, slide = values[0], values[LAW_SIZE]
    noise = 0.01 * hip, 0.01 * slide, 0.002 * hip, 0.002 * slide
    return np.array([*values, *noise, 0.0, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Reference of natural and free values."""

    leg: LegParameters
    """Leg with the inertias and springs of the file."""
    natural: Vector
    """Natural values of the file."""
    middle: tuple[float, float]
    """Reference pose of spring efforts, rad and m."""
    coriolis_share: Number
    over: tuple[OverPosition, OverPosition]
    """Friction over position of the file."""

    def sprung(self, axis: int) -> bool:
        """True if the file gives the axis a spring."""
        return bool(self.natural[SPRINGS + 3 * axis] > 0.0)

    def bristled(self, axis: int) -> bool:
        """True if the file gives the axis bristles."""
        return bool(self.natural[axis * LAW_SIZE + BRISTLES.start] > 0.0)

    def free(self, natural: Vector) -> Vector:
        """Convert natural to free values, both of shape (SIZE,)."""
        free = np.empty(SIZE)
        for axis in range(2):
            law = slice(axis * LAW_SIZE, (axis + 1) * LAW_SIZE)
            f = law_of(natural, axis)
            rising = np.maximum(natural[law], SMALLEST)
            hump = f.stribeck - smallest_stribeck(f)
            rising[1] = max(hump / max(f.coulomb, SMALLEST), HUMP_MIN_RATIO)
            free[law] = np.log(rising)
            at = SPRINGS + 3 * axis
            stiffness, rest, inertia = natural[at : at + 3]
            scale = SPRING_SCALE[axis]
            free[at] = stiffness / scale[0]
            free[at + 1] = stiffness * (self.middle[axis] - rest) / scale[1]
            free[at + 2] = inertia / scale[2]
            free[SLOPES[axis]] = natural[SLOPES[axis]] / SLOPE_SCALE
            free[OFFSETS[axis]] = natural[OFFSETS[axis]] / scale[1]
        free[NOISE:TIMING] = np.log(np.maximum(natural[NOISE:TIMING], SMALLEST))
        free[TIMING:] = natural[TIMING:] / TIMING_S
        return free

    def from_free(self, free: Vector) -> Vector:
        """Convert free to natural values, both of shape (SIZE,)."""
        natural = np.empty(SIZE)
        free = np.clip(free, -60.0, 60.0)
        for axis in range(2):
            law = slice(axis * LAW_SIZE, (axis + 1) * LAW_SIZE)
            natural[law] = np.exp(free[law])
            f = law_of(natural, axis)
            natural[law.start + 1] = f.stribeck * f.coulomb + smallest_stribeck(f)
            if not self.bristled(axis):
                natural[law][BRISTLES] = 0.0
            at = SPRINGS + 3 * axis
            scale = SPRING_SCALE[axis]
            natural[at], natural[at + 1] = 0.0, self.natural[at + 1]
            if self.sprung(axis):
                natural[at] = max(free[at], 1e-4) * scale[0]
                natural[at + 1] = self.middle[axis] - free[at + 1] * scale[1] / natural[at]
            natural[at + 2] = max(free[at + 2], 0.0) * scale[2]
            natural[SLOPES[axis]] = free[SLOPES[axis]] * SLOPE_SCALE
            natural[OFFSETS[axis]] = free[OFFSETS[axis]] * scale[1]
        natural[NOISE:TIMING] = np.exp(free[NOISE:TIMING])
        natural[TIMING:] = TIMING_S * free[TIMING:]
        return natural

    def leg_of(self, natural: Vector) -> LegParameters:
        """The mechanism with the natural values' springs and inertias."""
        hip, slide = natural[SPRINGS : SPRINGS + 3], natural[SPRINGS + 3 : SPRINGS + 6]
        more_hip = hip[2] - self.natural[SPRINGS + 2]
        more_slide = slide[2] - self.natural[SPRINGS + 5]
        return self.leg._replace(
            hip_stiffness=float(hip[0]),
            hip_rest_rad=float(hip[1]),
            slide_stiffness=float(slide[0]),
            slide_rest_m=float(slide[1]),
            thigh_inertia=self.leg.thigh_inertia + float(more_hip),
            slide_inertia=self.leg.slide_inertia + float(more_slide),
        )

    def model_of(self, natural: Vector) -> LegModel:
        """The mechanism and both friction laws."""
        hip, slide = law_of(natural, 0), law_of(natural, 1)
        return LegModel(self.leg_of(natural), hip, slide, self.coriolis_share)

    def over_of(self, natural: Vector) -> tuple[OverPosition, OverPosition]:
        """How both frictions rise along their axes."""
        hip, slide = natural[list(SLOPES)].tolist()
        return OverPosition(hip, self.over[0].middle), OverPosition(slide, self.over[1].middle)


def law_of(natural: Vector, axis: int) -> FrictionParameters:
    """Friction law of an axis from natural values."""
    coulomb, stribeck, *rest = natural[axis * LAW_SIZE : (axis + 1) * LAW_SIZE].tolist()
    return FrictionParameters(stribeck, coulomb, *rest)


def offsets_of(natural: Vector) -> Vector:
    """Efforts that the drives show at none, shape (2,): N·m and N."""
    return natural[list(OFFSETS)]


def noise_of(natural: Vector) -> Vector:
    """Noise of positions, efforts and frictions for `innovations`, shape (6,)."""
    return np.ascontiguousarray(natural[NOISE:TIMING])


def frame_of(robot: Robot, middle: tuple[float, float]) -> Frame:
    """The frame of a robot file and of a pose in the middle of a recording."""
    # Composed once here: this also checks friction as the kernels need it.
    friction_parameters(robot)
    share = 1.0 if robot.observer.coriolis else 0.0
    over = friction_over_position(robot)
    return Frame(leg_parameters(robot), natural_values(robot), middle, share, over)


def labelled(index: int) -> str:
    """Name such as `hip coulomb`."""
    if index < COUNT:
        return QUANTITIES[index].label
    return "noise of effort or friction" if index < TIMING else "timing of effort"
