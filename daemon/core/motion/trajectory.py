"""Reference trajectories of one leg: braking and holding, gait, open-loop excitation.

Each exercise is a frozen plan; an `advance_` function advances it by one cycle, and a `_reference`
function computes its reference. Poses are planned as hip and knee angles: the knee stays flexed on
the way, while a straight line in hip angle and slide position can cross the stretched leg. A way is
checked for clearance before it begins. Phases are in strides; no function here reads a clock.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from daemon.config.settings import Excite, Gait, Sinusoid
from daemon.ipc.record import Stage
from observer.mechanism.mechanism import (
    LegParameters,
    WorkspaceError,
    gravity,
    knee_angle,
    singularity_ratio,
    slide_position_for_knee,
)

Pair = tuple[float, float]
"""Hip and slide in joint units, or hip and knee in rad where the name says angles."""

PEAK_OF_MINIMUM_JERK = 1.875
"""Ratio of peak speed to mean speed of a minimum-jerk motion."""
SETTLE_S = 1.0
"""Rest at mid pose before an excitation begins."""
START_CADENCE_RATIO = 0.5
"""Share of the cadence at which the first stride begins."""
APPROACH_MIN_S = 0.5
WAY_POINTS = 50


class Reference(NamedTuple):
    """Reference of one leg in one cycle: position, velocity, and effort on top of g(q)."""

    position: Pair
    """Hip in rad, slide in m."""
    velocity: Pair
    """Hip in rad/s, slide in m/s."""
    feedforward: Pair
    """Effort on top of g: N·m, N."""
    guided: bool
    """The impedance pulls to the reference; otherwise torque is open-loop."""
    load: Pair | None = None
    """g of a fixed pose, where an open loop works about that pose; None: g(q)."""


class GaitShape(NamedTuple):
    """The periodic reference as Fourier series in rad: mean, and a - ib of a cos + b sin."""

    hip_mean_rad: float
    hip_harmonics_rad: tuple[complex, ...]
    """Highest harmonic first, in the order of Horner's rule."""
    knee_mean_rad: float
    knee_harmonics_rad: tuple[complex, ...]


def gait_shape(gait: Gait) -> GaitShape:
    """The gait shape from the settings of [gait], in rad."""
    return GaitShape(
        math.radians(gait.hip_mean_deg),
        _harmonics(gait.hip_harmonics_deg),
        math.radians(gait.knee_mean_deg),
        _harmonics(gait.knee_harmonics_deg),
    )


def _harmonics(cosines_and_sines_deg: Sequence[Sequence[float]]) -> tuple[complex, ...]:
    return tuple(
        complex(math.radians(a), -math.radians(b)) for a, b in reversed(cosines_and_sines_deg)
    )


def gait_angles(shape: GaitShape, phase: float, amplitude_ratio: float) -> Pair:
    """Hip and knee angle in rad at a phase in strides, scaled about the mean pose."""
    turn = cmath.rect(1.0, 2 * math.pi * phase)
    return (
        shape.hip_mean_rad + amplitude_ratio * _series(shape.hip_harmonics_rad, turn),
        shape.knee_mean_rad + amplitude_ratio * _series(shape.knee_harmonics_rad, turn),
    )


def _series(harmonics: tuple[complex, ...], turn: complex) -> float:
    value = 0j
    for harmonic in harmonics:
        value = (value + harmonic) * turn
    return value.real


def joints_of_angles(leg: LegParameters, angles: Pair) -> Pair:
    """Hip angle and slide position for a hip and a knee angle."""
    return angles[0], slide_position_for_knee(leg, angles[0], angles[1])


def angles_of_joints(leg: LegParameters, joints: Pair) -> Pair:
    """Hip and knee angle for a hip angle and a slide position."""
    return joints[0], knee_angle(leg, np.array(joints))


def load_at(leg: LegParameters, joints: Pair) -> Pair:
    """g(q) in N·m and N: the efforts that hold a pose against weight and springs."""
    load = gravity(leg, np.array(joints))
    return float(load[0]), float(load[1])


# --- hold -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Hold:
    """Plan that brakes from a speed and then holds the final position."""

    start: Pair
    start_velocity: Pair
    deceleration: Pair
    elapsed_s: float = 0.0


def advance_hold(hold: Hold, dt_s: float) -> Hold:
    """Advance the hold by one cycle."""
    return replace(hold, elapsed_s=hold.elapsed_s + dt_s)


def hold_reference(hold: Hold) -> Reference:
    """Reference on the braking ramp, then at its end."""
    on_ramp = [
        _brake(start, velocity, deceleration, hold.elapsed_s)
        for start, velocity, deceleration in zip(
            hold.start, hold.start_velocity, hold.deceleration, strict=True
        )
    ]
    (p0, v0), (p1, v1) = on_ramp
    return Reference((p0, p1), (v0, v1), (0.0, 0.0), guided=True)


def _brake(start: float, velocity: float, deceleration: float, elapsed_s: float) -> Pair:
    time_s = min(elapsed_s, abs(velocity) / deceleration)
    sign = math.copysign(1.0, velocity)
    position = start + velocity * time_s - 0.5 * sign * deceleration * time_s**2
    return position, velocity - sign * deceleration * time_s


# --- approach -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Approach:
    """A minimum-jerk motion from one pose to another, in hip and knee angles."""

    start_angles: Pair
    end_angles: Pair
    duration_s: float


def approach(leg: LegParameters, gait: Gait, start: Pair, end_angles: Pair) -> Approach:
    """Approach from joint position `start` to hip and knee angles, within the configured speeds."""
    end = joints_of_angles(leg, end_angles)
    duration_s = PEAK_OF_MINIMUM_JERK * max(
        abs(end[0] - start[0]) / gait.approach_hip_rad_per_s,
        abs(end[1] - start[1]) / gait.approach_slide_m_per_s,
    )
    return Approach(angles_of_joints(leg, start), end_angles, max(duration_s, APPROACH_MIN_S))


def way_is_clear(leg: LegParameters, motion: Approach, smallest_ratio: float) -> bool:
    """True if every pose on the way is reachable and above `smallest_ratio` of singularity."""
    try:
        way = [
            joints_of_angles(leg, _approach_angles(motion, motion.duration_s * k / WAY_POINTS))
            for k in range(1, WAY_POINTS + 1)
        ]
    except WorkspaceError:
        return False
    return all(singularity_ratio(leg, np.array(pose)) > smallest_ratio for pose in way)


def _approach_angles(motion: Approach, elapsed_s: float) -> Pair:
    part = _minimum_jerk(elapsed_s / motion.duration_s)
    (h0, k0), (h1, k1) = motion.start_angles, motion.end_angles
    return h0 + part * (h1 - h0), k0 + part * (k1 - k0)


def _minimum_jerk(x: float) -> float:
    x = min(max(x, 0.0), 1.0)
    return x**3 * (10 + x * (6 * x - 15))


# --- gait -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class GaitPlay:
    """Plan of a gait: announced, approached, played with ramps, ended at its mean pose."""

    leg: LegParameters
    shape: GaitShape
    motion: Approach
    start: Pair
    announce_s: float
    cadence_hz: float
    amplitude_ratio: float
    duration_s: float
    ramp_strides: float
    phase_offset_strides: float
    """Phase offset of this leg: the other leg walks half a stride later."""
    stage: Stage = Stage.ANNOUNCING
    elapsed_s: float = 0.0
    """Time in the stage."""
    strides: float = 0.0
    end_strides: float = 0.0
    """Value of `strides` when stage ENDING began."""


def advance_gait(play: GaitPlay, dt_s: float) -> GaitPlay:
    """Advance the gait by one cycle, and to the next stage where one is over."""
    elapsed_s, strides, stage = play.elapsed_s + dt_s, play.strides, play.stage
    if stage is Stage.PLAYING or stage is Stage.ENDING:
        strides += dt_s * _cadence_hz(play)
    if stage is Stage.ANNOUNCING and elapsed_s >= play.announce_s:
        return replace(play, stage=Stage.APPROACHING, elapsed_s=0.0)
    if stage is Stage.APPROACHING and elapsed_s >= play.motion.duration_s:
        return replace(play, stage=Stage.PLAYING, elapsed_s=0.0)
    if stage is Stage.PLAYING and elapsed_s >= play.duration_s:
        return replace(
            play, stage=Stage.ENDING, elapsed_s=0.0, strides=strides, end_strides=strides
        )
    if stage is Stage.ENDING and strides >= play.end_strides + 1:
        return replace(play, stage=Stage.OVER, elapsed_s=0.0, strides=strides)
    return replace(play, elapsed_s=elapsed_s, strides=strides)


def gait_reference(play: GaitPlay, dt_s: float) -> Reference:
    """Reference with the pose now, and the velocity to the pose one cycle later."""
    now, soon = _gait_joints(play), _gait_joints(advance_gait(play, dt_s))
    velocity = (soon[0] - now[0]) / dt_s, (soon[1] - now[1]) / dt_s
    return Reference(now, velocity, (0.0, 0.0), guided=True)


def gait_phase(play: GaitPlay) -> float:
    """Phase 0..1 of the stride, or -1 while no gait is played."""
    if play.stage not in {Stage.PLAYING, Stage.ENDING}:
        return -1.0
    return (play.strides + play.phase_offset_strides) % 1.0


def _gait_joints(play: GaitPlay) -> Pair:
    if play.stage == Stage.ANNOUNCING:
        return play.start
    if play.stage == Stage.APPROACHING:
        return joints_of_angles(play.leg, _approach_angles(play.motion, play.elapsed_s))
    angles = gait_angles(
        play.shape, play.strides + play.phase_offset_strides, _amplitude_ratio(play)
    )
    return joints_of_angles(play.leg, angles)


def _cadence_hz(play: GaitPlay) -> float:
    part = min(play.strides / play.ramp_strides, 1.0)
    return play.cadence_hz * (START_CADENCE_RATIO + (1 - START_CADENCE_RATIO) * part)


def _amplitude_ratio(play: GaitPlay) -> float:
    rising = _minimum_jerk(play.strides / play.ramp_strides)
    if play.stage == Stage.PLAYING:
        return play.amplitude_ratio * rising
    if play.stage == Stage.OVER:
        return 0.0
    risen = _minimum_jerk(play.end_strides / play.ramp_strides)
    return play.amplitude_ratio * risen * (1 - _minimum_jerk(play.strides - play.end_strides))


# --- torque -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class TorquePlay:
    """Plan of mode TORQUE: g(q) carries the leg and a controller's assist moves it, unguided."""

    elapsed_s: float = 0.0


def advance_torque(play: TorquePlay, dt_s: float) -> TorquePlay:
    """Advance the plan by one cycle."""
    return replace(play, elapsed_s=play.elapsed_s + dt_s)


def torque_reference(measured: Pair) -> Reference:
    """Reference at the measured pose, without stiffness or damping."""
    return Reference(measured, (0.0, 0.0), (0.0, 0.0), guided=False)


# --- excite ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ExcitePlay:
    """Plan of an open-loop scenario about g of mid pose, inside a window of positions.

    The load is g of mid pose throughout: the springs then bring the leg back, as in the paper.
    With g(q) every pose would be in equilibrium, and the leg would drift until it leaves its
    window.
    """

    leg: LegParameters
    motion: Approach
    middle: Pair
    middle_load: Pair
    """g at mid pose: N·m, N."""
    window: Pair
    torque: tuple[Sinusoid, ...]
    artificial: tuple[Sinusoid, ...]
    duration_s: float
    stage: Stage = Stage.APPROACHING
    elapsed_s: float = 0.0


def excite_window(excite: Excite) -> Pair:
    """Half width of the window about mid pose in rad and m."""
    return math.radians(excite.hip_window_deg), excite.slide_window_m


def advance_excite(play: ExcitePlay, dt_s: float, measured: Pair) -> ExcitePlay:
    """Advance by one cycle; it is over after its time, or when an axis has left the window."""
    play = replace(play, elapsed_s=play.elapsed_s + dt_s)
    if play.stage == Stage.APPROACHING and play.elapsed_s >= play.motion.duration_s + SETTLE_S:
        return replace(play, stage=Stage.PLAYING, elapsed_s=0.0)
    if play.stage == Stage.PLAYING and (
        play.elapsed_s >= play.duration_s or left_window(play, measured)
    ):
        return replace(play, stage=Stage.OVER, elapsed_s=0.0)
    return play


def left_window(play: ExcitePlay, measured: Pair) -> bool:
    """True if an axis is outside its window."""
    return any(
        abs(position - middle) > width
        for position, middle, width in zip(measured, play.middle, play.window, strict=True)
    )


def excite_reference(play: ExcitePlay, measured: Pair) -> Reference:
    """Reference of an excitation: guided to mid pose first, then torque only."""
    if play.stage == Stage.APPROACHING:
        angles = _approach_angles(play.motion, play.elapsed_s)
        return Reference(joints_of_angles(play.leg, angles), (0.0, 0.0), (0.0, 0.0), guided=True)
    feedforward = _sum(play.torque, play.elapsed_s)
    return Reference(measured, (0.0, 0.0), feedforward, guided=False, load=play.middle_load)


def artificial_disturbance(play: ExcitePlay) -> Pair:
    """d_art in N·m and N: seen = measured - d_art in the observer's input alone (paper, 4)."""
    return _sum(play.artificial, play.elapsed_s) if play.stage == Stage.PLAYING else (0.0, 0.0)


def _sum(parts: tuple[Sinusoid, ...], elapsed_s: float) -> Pair:
    total = {"hip": 0.0, "slide": 0.0}
    for part in parts:
        if part.start_s <= elapsed_s < part.end_s:
            total[part.axis] += _value(part, elapsed_s - part.start_s)
    return total["hip"], total["slide"]


def _value(part: Sinusoid, since_start_s: float) -> float:
    if part.kind == "step":
        return part.amplitude_si
    return part.amplitude_si * math.sin(2 * math.pi * part.frequency_hz * since_start_s)
