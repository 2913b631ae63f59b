"""Check that each drive has the torque for the quick-stop ramp that is written into it.

With too little torque the drive lags behind its ramp, and every sweep that relies on the ramp is
too optimistic. Rules of the computation, for `gaitd check`:

1. Required is M(q) a + c(q, q') + g(q) of the row of the axis, and the patient of [stop] against
   it, where one is configured. Friction and dampers would help; they are not counted.
2. Motions: the stride at the highest cadence, and every pose of the stride led by hand, each axis
   either way, at `hand_guiding_speed_max`. An axis that moves brakes against its motion; one that
   has come to rest, or never moved, stands. Both ends of a ramp count: at its speed, and at rest.
3. Available is the torque limit as it is written into that drive, in its own whole numbers.

A homing or a sign test has a lower limit in the drive; at its speed a ramp ends within a few
milliseconds either way, so this check leaves it out.
"""

import math
from collections.abc import Iterator
from itertools import product
from typing import Final, NamedTuple

import msgspec
from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import LegDrives, Settings
from daemon.config.drive_plan import drive_limits, effort_per_motor_nm
from daemon.config.robot import leg_parameters
from daemon.preflight import workspace
from daemon.preflight.motion import decelerations
from daemon.preflight.workspace import Pair
from drives.cia402.profile import DriveDescription
from drives.cia402.torque import count_nm
from drives.cia402.units import DriveLimits, expected_base, raw_limits
from observer.mechanism.linkage import dynamics
from observer.mechanism.parameters import LegParameters

PHASES: Final = 120
"""Number of poses over the stride."""
ROUNDS: Final = 20
"""Iterations until the effort left to the other axis has settled."""
_FULL: Final = 1.0
"""Full Coriolis terms."""
_KEYS: Final = (
    "hip.quick_stop_deceleration_rad_per_s2",
    "slide.quick_stop_deceleration_m_per_s2",
)


class BrakingMeaning(msgspec.Struct, frozen=True):
    """Effort that the quick-stop ramp of one axis requires; rad and N m, or m and N."""

    name: str
    rotary: bool
    deceleration_si_per_s2: float
    required_si: float
    """The largest, with the patient's effort, while the other axis brakes as its torque allows."""
    patient_si: float
    limit_si: float
    """The torque limit that is in the drive."""
    hip_deg: float
    slide_m: float
    """Pose at which the required effort is largest."""
    deceleration_max_si_per_s2: float
    """Deceleration that the torque limit can give, beside the other axis; 0 or less: none."""

    @property
    def is_given(self) -> bool:
        """True if the torque limit suffices."""
        return self.deceleration_si_per_s2 <= self.deceleration_max_si_per_s2


class _Braking(NamedTuple):
    """One axis braking at one pose: terms of its row of (6), positive in the braking direction."""

    pose: Pair
    inertia_si: float
    coupling_si: float
    """Inertia that couples the other axis's deceleration; 0 where that axis stands."""
    bias_si: float

    def required(self, own: float, other: float) -> float:
        return abs(self.inertia_si * own + self.coupling_si * other + self.bias_si)

    def largest(self, room: float, other: float) -> float:
        return (room - self.coupling_si * other - self.bias_si) / self.inertia_si


def braking_meanings(settings: Settings) -> tuple[BrakingMeaning, ...]:
    """The braking check of all axes, each leg's hip before its slide."""
    parameters, gait = leg_parameters(settings.robot), settings.trainer.gait
    limits = settings.limits
    motions = workspace.gait_motions(parameters, gait, gait.cadence_max_hz, PHASES)
    led = limits.hip.hand_guiding_speed_max_rad_per_s, limits.slide.hand_guiding_speed_max_m_per_s
    brakings: tuple[list[_Braking], list[_Braking]] = ([], [])
    for pose, velocity in motions:
        for axis, braking in _brakings(parameters, pose, _speeds(velocity, led)):
            brakings[axis].append(braking)
    return tuple(meaning for leg in settings.legs for meaning in _meanings(settings, leg, brakings))


def braking_errors(settings: Settings, meanings: tuple[BrakingMeaning, ...]) -> Errors:
    """Quick-stop decelerations that a drive's torque limit cannot give, with what would pass."""
    for index, meaning in enumerate(meanings):
        if not meaning.is_given:
            key, units = _KEYS[index % 2], _units(meaning)
            value = meaning.deceleration_si_per_s2
            yield ConfigError(settings.file.limits, key, value, _allowed(meaning, *units))


def _speeds(velocity: Pair, led: Pair) -> Iterator[Pair]:
    """Speeds of the stride, or with one axis at rest; and of hand guiding, each axis either way."""
    yield from product((velocity[0], 0.0), (velocity[1], 0.0))
    yield from product((led[0], 0.0, -led[0]), (led[1], 0.0, -led[1]))


def _brakings(
    leg: LegParameters, pose: Pair, speeds: Iterator[Pair]
) -> Iterator[tuple[int, _Braking]]:
    undamped = leg._replace(
        hip_damping=0.0, knee_damping=0.0, ankle_damping=0.0, slide_joint_damping=0.0
    )
    at_rest = dynamics(undamped, *pose, 0.0, 0.0, _FULL)
    for speed in speeds:
        hip, slide = (-math.copysign(1.0, v) if v else 0.0 for v in speed)
        for d in (dynamics(undamped, *pose, *speed, _FULL), at_rest):
            if hip:
                yield 0, _Braking(pose, d.m11, d.m12 * hip * slide, d.bias_hip * hip)
            if slide:
                yield 1, _Braking(pose, d.m22, d.m12 * hip * slide, d.bias_slide * slide)


def _meanings(
    settings: Settings, leg: LegDrives, brakings: tuple[list[_Braking], list[_Braking]]
) -> Iterator[BrakingMeaning]:
    drives, written = (leg.hip, leg.slide), decelerations(settings.limits)
    patient, bounds = _patient(settings), drive_limits(settings.limits)
    limits = tuple(_effort_limit_si(*both) for both in zip(drives, bounds, strict=True))
    rooms = limits[0] - patient[0], limits[1] - patient[1]
    most = _largest(brakings, rooms, written)
    for axis, drive in enumerate(drives):
        own, other = written[axis], max(min(written[1 - axis], most[1 - axis]), 0.0)
        worst = max(brakings[axis], key=lambda one: one.required(own, other))
        yield BrakingMeaning(
            name=drive.name,
            rotary=axis == 0,
            deceleration_si_per_s2=own,
            required_si=worst.required(own, other) + patient[axis],
            patient_si=patient[axis],
            limit_si=limits[axis],
            hip_deg=math.degrees(worst.pose[0]),
            slide_m=worst.pose[1],
            deceleration_max_si_per_s2=_rounded_down(most[axis]),
        )


def _largest(brakings: tuple[list[_Braking], list[_Braking]], rooms: Pair, written: Pair) -> Pair:
    """The largest decelerations up to those written that both drives can give together.

    For an axis whose written deceleration is possible, the result is the largest beside the
    other's.
    """

    def beside(axis: int, other: float) -> float:
        return min(one.largest(rooms[axis], other) for one in brakings[axis])

    hip, slide = written
    for _ in range(ROUNDS):
        hip, slide = (
            max(min(written[0], beside(0, slide)), 0.0),
            max(min(written[1], beside(1, hip)), 0.0),
        )
    return beside(0, slide), beside(1, hip)


def _rounded_down(deceleration: float) -> float:
    """Rounded down to hundredths, so that the reported value passes the check."""
    return math.floor(100.0 * deceleration) / 100.0


def _patient(settings: Settings) -> Pair:
    if settings.robot.patient is None:
        return 0.0, 0.0
    return settings.limits.stop.hip.patient_nm, settings.limits.stop.slide.patient_n


def _effort_limit_si(drive: DriveDescription, limits: DriveLimits) -> float:
    """Effort at the joint for the torque limit that is written into the drive."""
    count = count_nm(drive.profile.torque_limit, expected_base(drive)) * effort_per_motor_nm(drive)
    return raw_limits(limits, drive).torque_raw * count


def _units(meaning: BrakingMeaning) -> tuple[str, str]:
    return ("rad/s^2", "N m") if meaning.rotary else ("m/s^2", "N")


def _allowed(meaning: BrakingMeaning, acceleration: str, effort: str) -> str:
    most = meaning.deceleration_max_si_per_s2
    passes = f"<= {most:.2f} {acceleration}" if most > 0 else "none with this torque limit"
    against = f", {meaning.patient_si:g} of them against the patient" if meaning.patient_si else ""
    return (
        f"{passes}: at hip {meaning.hip_deg:.1f} deg, slide {meaning.slide_m:.3f} m the ramp asks "
        f"{meaning.required_si:.1f} {effort} of {meaning.name}{against}, and its limit is "
        f"{meaning.limit_si:.1f}"
    )
