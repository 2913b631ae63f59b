"""Stability of the loops that the core closes over the bus: hold, gait, soft limits, hand guiding.

The core samples the position q at SYNC k, takes the speed from the difference to SYNC k-1, and
sends an effort that the drive applies at SYNC k+1 and keeps for one cycle:

    u[k+1] = -K q[k] - D (q[k] - q[k-1]) / T

Between two SYNCs the leg moves by M(q) q'' = u. For both axes together these are eight numbers from
one SYNC to the next (q, q', q[k-1], u); the loop is stable if all eigenvalues of their matrix are
inside the unit circle. Too much damping is as unstable as too little: with the delay, it pushes
with the motion of two cycles ago.

1. M is that of each pose of the workspace, with the configured patient and without one: a lighter
   leg is less stable.
2. Friction and dampers would help; they are not counted. Limits of torque and of its rate are not
   counted either: a motion so large that they act can shake a loop that is stable here. It ends at
   the limits of position, speed and tracking.
3. The margin is the number of times that M could be smaller, or D alone.
4. A soft limit damps motion outwards alone. An oscillation meets it in half of its time, so half of
   its damping counts. It is taken from `soft_limits.slowed` itself. Below a margin of 1 a leg
   without friction that comes in fast goes on to shake with the whole effort.
5. In hand guiding a spring leads back in at each end of the range. It acts over the soft margin
   alone, and friction may take out what its delay puts in: an oscillation of amplitude A, growth
   rate s and frequency w needs pi/2 m s w A of Coulomb friction, with A half of the soft margin.
   The margin is the number of times that `coulomb` of robot.toml has that, where it is least
   along the axis.

6. The effort also carries g of q[k], which is 15 ms late: as damping, that is 15 ms of dg/dq. It is
   left out. Over the shipped workspaces dg/dq is positive definite, and would add to the damping.

A drive's own loops, which guide a gait by position, are not part of this.
"""

import cmath
import math
from collections.abc import Callable, Iterator
from itertools import product
from typing import Final, NamedTuple

import msgspec
import numpy as np
from gaitd_toml import ConfigError, Errors
from numpy.typing import NDArray

from daemon.config.bundle import Settings
from daemon.config.robot import friction_range, leg_parameters
from daemon.config.settings import Impedance
from daemon.core.safety import soft_limits
from daemon.core.safety.limits import AxisLimits, axis_limits, thresholds
from daemon.preflight.motion import limit_box
from daemon.preflight.workspace import Pair
from observer.mechanism.mechanism import mass_matrix, singularity_ratio
from observer.mechanism.parameters import LegParameters

Vector = NDArray[np.float64]
Indices = NDArray[np.intp]

HIP_POINTS: Final = 9
SLIDE_POINTS: Final = 9
"""Poses over the range of each axis, both ends included: the soft limits damp most there."""
MARGIN_SMALL: Final = 1.25
"""Below, a warning: a leg lighter by a fifth would shake."""
MARGIN_MAX: Final = 16.0
MARGIN_MIN: Final = 1.0 / 16.0
SEARCH_STEPS: Final = 10
"""Halvings of the search for a margin: within 0.5 %."""
TRIED: Final = np.geomspace(1 / 64, 64, 97)
"""Factors with which an allowed value is looked for, of the refused one."""
ROUNDING: Final = 1e-6
"""Allowance for an eigenvalue that is 1 where nothing acts on an axis."""
_NONE: Final = (0.0, 0.0)


class LoopMeaning(msgspec.Struct, frozen=True):
    """Stability of one loop at the pose and with the leg where its margin is least."""

    loop: str
    leg: str
    """`with the patient` or `empty`."""
    margin_ratio: float
    """Below 1 the loop shakes; 16 stands for all above, 0 for all below 1/16."""
    hip_deg: float
    slide_m: float
    file: str
    key: str
    value: float
    """The number at fault if the margin is too small."""
    allowed: str
    """The values of this number alone with which the loop is stable; empty if it is."""
    counts_friction: bool
    """An end spring of hand guiding (rule 5): below 1 it is a warning."""

    @property
    def is_stable(self) -> bool:
        """True if the loop does not shake."""
        return self.margin_ratio >= 1.0

    @property
    def is_refused(self) -> bool:
        """True if it shakes the leg, but for an end spring."""
        return not (self.is_stable or self.counts_friction)


class Poses(NamedTuple):
    """One leg at n poses."""

    leg: str
    position: Vector
    """Shape (n, 2): rad, m."""
    inverse_mass: Vector
    """Shape (n, 2, 2)."""
    soft_damping: Vector
    """Shape (n, 2, 2): of the soft limits, the mean of motion either way."""

    def picked(self, which: Indices) -> "Poses":
        """Some of the poses."""
        return Poses(
            self.leg, self.position[which], self.inverse_mass[which], self.soft_damping[which]
        )


class Gains(NamedTuple):
    """Stiffness and damping of hip and slide: N m, rad and N, m."""

    stiffness: Pair
    damping: Pair
    soft_share: Pair = _NONE
    """Share of the soft limits' damping, by axis."""

    def times(self, factor: float) -> "Gains":
        """All of it, as a leg that is lighter by this factor feels it."""
        return Gains(*((factor * hip, factor * slide) for hip, slide in self))

    def with_damping_over(self, factor: float) -> "Gains":
        """The same stiffness with less damping."""
        (d0, d1), (s0, s1) = self.damping, self.soft_share
        return Gains(self.stiffness, (d0 / factor, d1 / factor), (s0 / factor, s1 / factor))


class _Loop(NamedTuple):
    """One loop, and its numbers that are named first when it shakes."""

    name: str
    file: str
    keys: tuple[str, str]
    numbers: Pair
    gains_with: Callable[[Pair], Gains]
    """The gains of the loop with other numbers."""
    stiffness_keys: tuple[str, str] | None = None
    """The numbers that are named where no damping helps."""


def loop_meanings(settings: Settings) -> tuple[LoopMeaning, ...]:
    """The stability of all loops, each with the leg and at the pose where it is least."""
    legs = tuple(poses_of(settings, *leg) for leg in _legs(settings))
    period_s = settings.trainer.cycle.period_ms * 1e-3
    loops = tuple(_meaning(loop, legs, period_s) for loop in _loops(settings))
    return (*loops, *_end_springs(settings, legs, period_s))


def loop_errors(meanings: tuple[LoopMeaning, ...]) -> Errors:
    """Loops that shake the leg: of each number the one with the least margin.

    Soft limits only where the loop that they are part of is good.
    """
    small = _small(meanings)
    own = [loop for loop in meanings if loop.is_refused and not _is_of_another(loop, small)]
    by_margin = sorted(own, key=lambda loop: -loop.margin_ratio)
    for loop in {(loop.file, loop.key): loop for loop in by_margin}.values():
        yield ConfigError(loop.file, loop.key, loop.value, f"{loop.allowed}: {_why(loop)}")


def loop_warnings(meanings: tuple[LoopMeaning, ...]) -> Iterator[str]:
    """Loops with a small margin; soft limits only where the loop that they are part of is good."""
    small = _small(meanings)
    for loop in meanings:
        if loop.loop not in small or loop.is_refused or _is_of_another(loop, small):
            continue
        wanted = loop.allowed or f"{MARGIN_SMALL:g} or more is advised"
        yield str(ConfigError(loop.file, loop.key, loop.value, f"{_why(loop)}; {wanted}"))


def _small(meanings: tuple[LoopMeaning, ...]) -> set[str]:
    return {loop.loop for loop in meanings if loop.margin_ratio < MARGIN_SMALL}


def _is_of_another(loop: LoopMeaning, small: set[str]) -> bool:
    """True for a soft limit in a loop with a small margin of its own: that one is to be mended."""
    return loop.loop.removeprefix(_SOFT) in small - {loop.loop}


def _why(loop: LoopMeaning) -> str:
    return (
        f"the margin against shaking is {loop.margin_ratio:.2f} in {loop.loop} "
        f"({loop.leg}, hip {loop.hip_deg:.0f} deg, slide {loop.slide_m:.2f} m)"
        + ("" if loop.is_stable else "; below 1 it shakes")
    )


def _legs(settings: Settings) -> Iterator[tuple[str, LegParameters]]:
    robot = settings.robot
    if robot.patient is not None:
        yield "with the patient", leg_parameters(robot)
    yield "empty", leg_parameters(msgspec.structs.replace(robot, patient=None))


def poses_of(
    settings: Settings, name: str, leg: LegParameters, positions: tuple[Pair, ...] = ()
) -> Poses:
    """A leg at some positions (rad, m), or else at a grid of them over its workspace."""
    box, stop_ratio = limit_box(settings.limits), settings.limits.singularity.stop_ratio
    ends = zip(box.low, box.high, (HIP_POINTS, SLIDE_POINTS), strict=True)
    grid = positions or product(*(np.linspace(*end).tolist() for end in ends))
    limits = axis_limits(settings.limits, settings.robot)
    bounds = thresholds(settings.limits, settings.trainer.cycle.period_ms)
    rows: list[tuple[Pair, Vector, Vector]] = []
    for position in grid:
        ratio = float(singularity_ratio(leg, np.array(position)))
        if ratio >= stop_ratio:
            zone = soft_limits.zone_at(limits, bounds, position, ratio)
            inverse_mass = np.linalg.inv(mass_matrix(leg, np.array(position))).astype(float)
            rows.append((position, inverse_mass, _soft_damping(zone, leg, limits, position)))
    reached, masses, soft = map(np.array, zip(*rows, strict=True))
    return Poses(name, reached, masses, soft)


def _soft_damping(
    zone: soft_limits.SoftZone,
    leg: LegParameters,
    limits: tuple[AxisLimits, AxisLimits],
    position: Pair,
) -> Vector:
    def effort(*velocity: float) -> Vector:
        hip, slide = velocity
        return np.array(soft_limits.slowed(zone, leg, limits, position, (hip, slide), _NONE, _NONE))

    mean = (effort(-1.0, 0.0) - effort(1.0, 0.0)), (effort(0.0, -1.0) - effort(0.0, 1.0))
    return 0.5 * np.array(mean).T


def margin_of(poses: Poses, gains: Gains, period_s: float) -> tuple[float, int]:
    """The least margin of a loop over some poses, and the index of that pose."""
    lighter = _largest(poses, period_s, gains.times, MARGIN_MIN)
    if lighter[0] < 1.0 or gains.stiffness == _NONE:
        return lighter
    return min(lighter, _largest(poses, period_s, gains.with_damping_over, 1.0))


def _largest(
    poses: Poses, period_s: float, gains_at: Callable[[float], Gains], low: float
) -> tuple[float, int]:
    """The largest factor that is stable at all poses, and the pose that ends there."""
    high = MARGIN_MAX
    left = np.arange(len(poses.position))
    if not len(_unstable(poses, gains_at(high), period_s)):
        return MARGIN_MAX, 0
    if len(unstable := _unstable(poses, gains_at(low), period_s)):
        return 0.0, int(unstable[0])
    for _ in range(SEARCH_STEPS):
        middle = math.sqrt(low * high)
        unstable = left[_unstable(poses.picked(left), gains_at(middle), period_s)]
        if len(unstable):
            high, left = middle, unstable
        else:
            low = middle
    return low, int(left[0])


def _unstable(poses: Poses, gains: Gains, period_s: float) -> Indices:
    """Indices of the poses at which the loop shakes."""
    share = np.diag(np.sqrt(gains.soft_share))
    stiffness = np.diag(gains.stiffness)
    damping = np.diag(gains.damping) + share @ poses.soft_damping @ share
    matrix = _matrix(poses.inverse_mass, stiffness, damping, period_s)
    radius = np.abs(np.linalg.eigvals(matrix)).max(axis=1)
    return np.flatnonzero(radius > 1.0 + ROUNDING)


def _matrix(inverse_mass: Vector, stiffness: Vector, damping: Vector, period_s: float) -> Vector:
    """From one SYNC to the next: position, velocity, position before, effort of each axis."""
    axes = inverse_mass.shape[-1]
    blocks = np.zeros((len(inverse_mass), 4, axes, 4, axes))
    one = np.eye(axes)
    blocks[:, 0, :, 0] = blocks[:, 1, :, 1] = blocks[:, 2, :, 0] = one
    blocks[:, 0, :, 1] = period_s * one
    blocks[:, 0, :, 3] = 0.5 * period_s**2 * inverse_mass
    blocks[:, 1, :, 3] = period_s * inverse_mass
    blocks[:, 3, :, 0] = -stiffness - damping / period_s
    blocks[:, 3, :, 2] = damping / period_s
    return blocks.reshape(-1, 4 * axes, 4 * axes)


def _loops(settings: Settings) -> Iterator[_Loop]:
    trainer, file = settings.trainer, str(settings.file.path)
    tables = [("hold", trainer.hold)]
    if trainer.gait.guidance == "impedance":
        tables.append(("gait.impedance", trainer.gait.impedance))
    for name, table in tables:
        keys = f"{name}.hip.damping_nm_s_per_rad", f"{name}.slide.damping_n_s_per_m"
        yield from _both(settings, _guided(name, file, keys, table))
    hand = trainer.hand_guiding
    slow = hand.hip.damping_nm_s_per_rad, hand.slide.damping_n_s_per_m
    numbers = hand.hip.damping_beyond_nm_s_per_rad, hand.slide.damping_beyond_n_s_per_m

    def with_beyond(beyond: Pair) -> Gains:
        return Gains(_NONE, (slow[0] + beyond[0], slow[1] + beyond[1]))

    yield from _both(settings, _Loop("hand_guiding", file, _BEYOND, numbers, with_beyond))


def _guided(name: str, file: str, keys: tuple[str, str], table: Impedance) -> _Loop:
    stiffness = table.hip.stiffness_nm_per_rad, table.slide.stiffness_n_per_m
    numbers = table.hip.damping_nm_s_per_rad, table.slide.damping_n_s_per_m

    def with_damping(damping: Pair) -> Gains:
        return Gains(stiffness, damping)

    stiff = f"{name}.hip.stiffness_nm_per_rad", f"{name}.slide.stiffness_n_per_m"
    return _Loop(name, file, keys, numbers, with_damping, stiff)


def _both(settings: Settings, loop: _Loop) -> Iterator[_Loop]:
    """A loop, and the same one inside the soft limits."""
    soft, gains = settings.limits.soft_limit, loop.gains_with(loop.numbers)
    numbers = soft.hip.damping_nm_s_per_rad, soft.slide.damping_n_s_per_m

    def with_soft(damping: Pair) -> Gains:
        hip, slide = (a / b if b else 0.0 for a, b in zip(damping, numbers, strict=True))
        return gains._replace(soft_share=(hip, slide))

    yield loop
    keys = "soft_limit.hip.damping_nm_s_per_rad", "soft_limit.slide.damping_n_s_per_m"
    yield _Loop(f"{_SOFT}{loop.name}", str(settings.file.limits), keys, numbers, with_soft)


_SOFT: Final = "soft limit in "
_BEYOND: Final = (
    "hand_guiding.hip.damping_beyond_nm_s_per_rad",
    "hand_guiding.slide.damping_beyond_n_s_per_m",
)


def _meaning(loop: _Loop, legs: tuple[Poses, ...], period_s: float) -> LoopMeaning:
    gains = loop.gains_with(loop.numbers)
    (margin, index), poses = min(
        ((margin_of(poses, gains, period_s), poses) for poses in legs), key=lambda each: each[0][0]
    )
    at = poses.picked(np.array([index]))
    axis = min((0, 1), key=lambda axis: margin_of(at, _only(gains, axis), period_s)[0])
    key, value, allowed = loop.keys[axis], loop.numbers[axis], ""
    if margin < 1.0:
        allowed = _allowed_damping(loop, legs, axis, period_s)
        if not allowed and loop.stiffness_keys is not None:
            key, value = loop.stiffness_keys[axis], gains.stiffness[axis]
            allowed = _allowed_stiffness(gains, legs, axis, period_s)
    hip_rad, slide_m = poses.position[index].tolist()
    return LoopMeaning(
        loop=loop.name,
        leg=poses.leg,
        margin_ratio=margin,
        hip_deg=math.degrees(hip_rad),
        slide_m=slide_m,
        file=loop.file,
        key=key,
        value=value,
        allowed=allowed,
        counts_friction=False,
    )


def _only(gains: Gains, axis: int) -> Gains:
    """The gains of one axis, with nothing on the other."""
    pairs = ((pair[0], 0.0) if axis == 0 else (0.0, pair[1]) for pair in gains)
    return Gains(*pairs)


def _allowed_damping(loop: _Loop, legs: tuple[Poses, ...], axis: int, period_s: float) -> str:
    """The values of one damping, beside all others, with which the loop does not shake; or ""."""
    stiffness = loop.gains_with(loop.numbers).stiffness[axis]
    start = loop.numbers[axis] or stiffness * period_s
    stable: list[float] = []
    for value in (start * TRIED).tolist():
        numbers = (value, loop.numbers[1]) if axis == 0 else (loop.numbers[0], value)
        if _is_stable(_only(loop.gains_with(numbers), axis), legs, period_s):
            stable.append(value)
    if not stable:
        return "" if stiffness else "less"
    least = f">= {stable[0]:.3g} and " if stiffness else ""
    return f"{least}<= {stable[-1]:.3g}"


def _allowed_stiffness(gains: Gains, legs: tuple[Poses, ...], axis: int, period_s: float) -> str:
    """The stiffness of one axis, beside its damping, with which the loop does not shake."""
    only = _only(gains, axis)
    tried = (
        (ratio * only.stiffness[0], ratio * only.stiffness[1]) for ratio in TRIED[::-1].tolist()
    )
    stable = (pair for pair in tried if _is_stable(only._replace(stiffness=pair), legs, period_s))
    found = next(stable, None)
    return "less, with another damping" if found is None else f"<= {found[axis]:.3g}"


def _is_stable(gains: Gains, legs: tuple[Poses, ...], period_s: float) -> bool:
    return not any(len(_unstable(poses, gains, period_s)) for poses in legs)


def _end_springs(
    settings: Settings, legs: tuple[Poses, ...], period_s: float
) -> Iterator[LoopMeaning]:
    limits, hand = settings.limits, settings.trainer.hand_guiding
    springs = (
        _EndSpring(
            "hip", math.radians(limits.hip.soft_margin_deg), hand.hip.damping_nm_s_per_rad, period_s
        ),
        _EndSpring("slide", limits.slide.soft_margin_m, hand.slide.damping_n_s_per_m, period_s),
    )
    edges = {"hip.edge_nm": hand.hip.edge_nm, "slide.edge_n": hand.slide.edge_n}
    frictions, _ = friction_range(settings.robot, settings.limits)
    for axis, (spring, (key, edge)) in enumerate(zip(springs, edges.items(), strict=True)):
        # The lightest leg: the inertia of this axis while the other one is free.
        poses = max(legs, key=lambda each: each.inverse_mass[:, axis, axis].max())
        index = int(poses.inverse_mass[:, axis, axis].argmax())
        inverse_mass, coulomb = (
            float(poses.inverse_mass[index, axis, axis]),
            frictions[axis].coulomb,
        )
        need = spring.friction_needed(edge, inverse_mass)
        tried = [each for each in (edge * TRIED).tolist() if each <= edge]
        most = max(
            (each for each in tried if spring.friction_needed(each, inverse_mass) <= coulomb),
            default=0.0,
        )
        hip_rad, slide_m = poses.position[index].tolist()
        yield LoopMeaning(
            loop=f"end spring of the {spring.axis} in hand_guiding",
            leg=poses.leg,
            margin_ratio=MARGIN_MAX if need * MARGIN_MAX < coulomb else coulomb / need,
            hip_deg=math.degrees(hip_rad),
            slide_m=slide_m,
            file=str(settings.file.path),
            key=f"hand_guiding.{key}",
            value=edge,
            allowed="" if need <= coulomb else f"<= {most:.3g}, or a wider soft margin",
            counts_friction=True,
        )


class _EndSpring(NamedTuple):
    """The spring of hand guiding at the ends of one axis; rad and N m, or m and N."""

    axis: str
    margin_si: float
    damping_si: float
    period_s: float

    def friction_needed(self, edge_si: float, inverse_mass: float) -> float:
        """Coulomb friction that takes out what the delay puts in (rule 5)."""
        stiffness, damping = np.array([[edge_si / self.margin_si]]), np.array([[self.damping_si]])
        matrix = _matrix(np.array([[[inverse_mass]]]), stiffness, damping, self.period_s)
        eigenvalues: list[complex] = np.linalg.eigvals(matrix)[0].tolist()
        fastest = max(eigenvalues, key=abs)
        growth = math.log(max(abs(fastest), 1.0)) / self.period_s
        frequency = abs(cmath.phase(fastest)) / self.period_s
        return 0.25 * math.pi * growth * frequency * self.margin_si / inverse_mass
