"""The scripted patient: efforts over time, over the stride, at rest, against the motion.

A programme is a list of efforts (plant_settings.Effort). The kernels read it as one record array,
so that only numbers enter the physics step. Every effort has an envelope (rise, hold, fall) times a
wave; the result passes a first-order activation, as in muscles.

The plant estimates the stride's phase itself: a second-order generalised integrator with a
frequency-locked loop on the hip angle. It does not lock below a few degrees of swing, so a resting
leg has no stride.
Source: Rodriguez, Luna, Candela, Mujal, Teodorescu, Blaabjerg, "Multiresonant frequency-locked loop
for grid synchronization of power converters", IEEE Trans. Ind. Electron. 58 (2011), eq. (1), (7).
"""

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.jit import kernel
from sim_drives.plant.recorded import SAMPLES, STRIDES_MAX, Values
from sim_drives.plant.settings import Effort, Gait, Programme, Push, Recorded, Sine, Spasm

Records = NDArray[np.void]


class Wave(IntEnum):
    """Shape of an effort within its envelope."""

    STEADY = 0
    SINE = 1
    GAIT = 2
    PUSH = 3
    SPASM = 4
    RECORDED = 5


WAVES: Final[dict[type[Effort], Wave]] = {
    Sine: Wave.SINE,
    Gait: Wave.GAIT,
    Push: Wave.PUSH,
    Spasm: Wave.SPASM,
    Recorded: Wave.RECORDED,
}

EFFORT: Final = np.dtype(
    [
        ("wave", "i8"),
        ("at_s", "f8"),
        ("until_s", "f8"),
        ("rise_s", "f8"),
        ("fall_s", "f8"),
        ("peak", "f8", (2,)),  # N·m, N
        ("pulsation", "f8"),  # rad/s; for GAIT: the harmonic
        ("phase_rad", "f8", (2,)),
        ("rest_speed", "f8", (2,)),  # rad/s, m/s
        ("direction", "f8", (2,)),  # latched at the onset of a spasm; 0: not latched
        ("stride_count", "i8"),  # of a recorded effort
        ("stride_index", "i8"),
        ("theta_rad", "f8"),  # of the last step
        ("samples", "f8", (STRIDES_MAX, SAMPLES, 2)),
    ]
)
"""One effort of the running programme."""

STRIDE: Final = np.dtype(
    [
        ("in_phase_rad", "f8"),
        ("quadrature_rad", "f8"),
        ("mean_rad", "f8"),
        ("pulsation_rad_per_s", "f8"),
    ]
)
"""State of the locked oscillator."""

SELECTIVITY: Final = 0.6
"""Gain k of the integrator: a smaller one rejects the gait's harmonics better and locks later."""
MEAN_GAIN: Final = 0.1
"""Gain of the offset's integrator, per pulsation."""
LOCK_GAIN: Final = 1.0
"""Gain of the frequency, per radian of stride; it locks in about two strides."""
SLOWEST_RAD_PER_S: Final = 2 * math.pi * 0.1
FASTEST_RAD_PER_S: Final = 2 * math.pi * 1.0
START_RAD_PER_S: Final = 2 * math.pi * 0.3
BLIND_RAD: Final = math.radians(3.0)
"""Swing amplitude below which there is no stride."""
FULL_RAD: Final = math.radians(10.0)
"""Swing amplitude from which an effort over the stride has its full size."""


def compile_programme(
    programme: Programme, recorded: Mapping[str, Values]
) -> tuple[Records, float]:
    """Return the programme in the kernels' form, and its repetition in s (infinite: none).

    Args:
        programme: of plant.toml.
        recorded: strides by the file of a recorded effort.
    """
    table = np.zeros(len(programme.effort), EFFORT)
    for row, effort in zip(table, programme.effort, strict=True):
        _fill(row, effort)
        if isinstance(effort, Recorded):
            strides = recorded[effort.file]
            row["stride_count"] = len(strides)
            row["samples"][: len(strides)] = strides
    return table, programme.repeat_s or math.inf


def _fill(row: np.void, effort: Effort) -> None:
    row["wave"] = WAVES.get(type(effort), Wave.STEADY)
    row["at_s"], row["until_s"] = effort.at_s, effort.until_s
    row["rise_s"], row["fall_s"] = effort.rise_s, effort.fall_s
    row["peak"] = (effort.hip.torque_nm, effort.slide.force_n)
    if isinstance(effort, Sine | Gait):
        row["phase_rad"] = np.radians((effort.hip.phase_deg, effort.slide.phase_deg))
    if isinstance(effort, Sine):
        row["pulsation"] = 2 * math.pi * effort.frequency_hz
    if isinstance(effort, Gait):
        row["pulsation"] = effort.harmonic
    if isinstance(effort, Push):
        row["rest_speed"] = (effort.hip.rest_rad_per_s, effort.slide.rest_m_per_s)


def resting_stride(hip_angle_rad: float) -> Records:
    """Return the oscillator of a leg at rest, as an array of one record."""
    stride = np.zeros(1, STRIDE)
    stride["mean_rad"] = hip_angle_rad
    stride["pulsation_rad_per_s"] = START_RAD_PER_S
    return stride


@kernel
def follow_stride(stride: np.void, hip_angle_rad: float, step_s: float) -> None:
    """Update the oscillator with the hip's motion of one step.

    After two strides theta = atan2(quadrature, in phase) is the phase of the hip's fundamental,
    0 at the largest flexion.
    """
    pulsation = stride["pulsation_rad_per_s"]
    x = stride["in_phase_rad"]
    y = stride["quadrature_rad"]
    error = hip_angle_rad - stride["mean_rad"] - x
    x += step_s * pulsation * (SELECTIVITY * error - y)
    y += step_s * pulsation * x
    lock = error * y / (x * x + y * y + BLIND_RAD * BLIND_RAD)
    pulsation -= step_s * LOCK_GAIN * SELECTIVITY * pulsation * pulsation * lock
    stride["in_phase_rad"] = x
    stride["quadrature_rad"] = y
    stride["mean_rad"] += step_s * MEAN_GAIN * pulsation * error
    stride["pulsation_rad_per_s"] = min(max(pulsation, SLOWEST_RAD_PER_S), FASTEST_RAD_PER_S)


@kernel
def swing_weight(stride: np.void) -> float:
    """Weight of an effort over the stride: 0 at rest, 1 from FULL_RAD of swing."""
    amplitude = math.hypot(stride["in_phase_rad"], stride["quadrature_rad"])
    return min(max((amplitude - BLIND_RAD) / (FULL_RAD - BLIND_RAD), 0.0), 1.0)


@kernel
def envelope(since_s: float, left_s: float, rise_s: float, fall_s: float) -> float:
    """Rise, hold, fall: 0 outside, 1 between, linear on the flanks."""
    if since_s < 0.0 or left_s <= 0.0:
        return 0.0
    up = since_s / rise_s if since_s < rise_s else 1.0
    down = left_s / fall_s if left_s < fall_s else 1.0
    return min(up, down)


@kernel
def _latch_direction(effort: np.void, speed: NDArray[np.float64]) -> None:
    for axis in range(2):
        if effort["direction"][axis] == 0.0:
            effort["direction"][axis] = 1.0 if speed[axis] >= 0.0 else -1.0


@kernel
def _turn_to_stride(effort: np.void, theta_rad: float) -> None:
    """Take the next recorded stride where the phase passes pi, the last one where it goes back."""
    turn = theta_rad - effort["theta_rad"]
    count = effort["stride_count"]
    if turn < -math.pi:
        effort["stride_index"] = (effort["stride_index"] + 1) % count
    if turn > math.pi:
        effort["stride_index"] = (effort["stride_index"] + count - 1) % count
    effort["theta_rad"] = theta_rad


@kernel
def _recorded(effort: np.void, axis: int, theta_rad: float) -> float:
    """Interpolate between samples; the last one is followed by the next stride's first."""
    at = (theta_rad + math.pi) / (2.0 * math.pi) * SAMPLES
    first = min(max(int(at), 0), SAMPLES - 1)
    stride, second = effort["stride_index"], first + 1
    following = stride
    if second == SAMPLES:
        following, second = (stride + 1) % effort["stride_count"], 0
    before = effort["samples"][stride, first, axis]
    return before + (at - first) * (effort["samples"][following, second, axis] - before)


@kernel
def _wave(effort: np.void, axis: int, since_s: float, theta_rad: float, speed: float) -> float:
    kind = effort["wave"]
    if kind == Wave.SINE:
        return math.cos(effort["pulsation"] * since_s + effort["phase_rad"][axis])
    if kind == Wave.GAIT:
        return math.cos(effort["pulsation"] * theta_rad + effort["phase_rad"][axis])
    if kind == Wave.RECORDED:
        return _recorded(effort, axis, theta_rad)
    if kind == Wave.PUSH:
        ratio = speed / effort["rest_speed"][axis]
        return 1.0 / (1.0 + ratio * ratio)
    if kind == Wave.SPASM:
        return -effort["direction"][axis]
    return 1.0


@kernel
def script(
    programme: Records,
    stride: np.void,
    elapsed_s: float,
    speed: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Compute the scripted effort of the muscles, `elapsed_s` after the programme began.

    Args:
        programme: efforts, EFFORT records; a spasm's direction and the recorded stride are written.
        stride: the oscillator, a STRIDE record.
        elapsed_s: since the programme began or was repeated.
        speed: shape (2,), rad/s and m/s.
        out: shape (2,), written: N·m and N along the positive axes.
    """
    out[:] = 0.0
    theta_rad = math.atan2(stride["quadrature_rad"], stride["in_phase_rad"])
    for index in range(programme.size):
        effort = programme[index]
        since_s = elapsed_s - effort["at_s"]
        left_s = effort["until_s"] - elapsed_s
        weight = envelope(since_s, left_s, effort["rise_s"], effort["fall_s"])
        if since_s < 0.0 or left_s <= 0.0:
            effort["direction"][:] = 0.0
            continue
        if effort["wave"] == Wave.SPASM:
            _latch_direction(effort, speed)
        if effort["wave"] == Wave.RECORDED:
            _turn_to_stride(effort, theta_rad)
        if effort["wave"] == Wave.GAIT or effort["wave"] == Wave.RECORDED:
            weight *= swing_weight(stride)
        for axis in range(2):
            wave = _wave(effort, axis, since_s, theta_rad, speed[axis])
            out[axis] += weight * effort["peak"][axis] * wave
