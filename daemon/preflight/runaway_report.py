"""Compares how far a leg runs after the core has ended with max_runaway of limits.toml.

For `gaitd check`. The distance is computed by `runaway.py`. A configuration that exceeds
max_runaway is refused by its torque limit, the key to change first.
"""

import math
from collections.abc import Iterator
from typing import Final

import msgspec
from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import LegDrives, Settings
from daemon.config.drive_plan import drive_limits
from daemon.config.robot import friction_range, leg_parameters
from daemon.config.settings import Cycle
from daemon.preflight import workspace
from daemon.preflight.runaway import AxisRunaway, Runaway, worst_runaways
from daemon.preflight.workspace import Pair
from drives.cia402.profile import DriveDescription, Keeps
from drives.cia402.units import DriveLimits

POSES: Final = 24
"""Number of poses over the stride at which the core may end."""
SEARCH_STEPS: Final = 64
"""Steps of the search for an allowed torque limit, as fractions of the refused one."""
_MS: Final = 1e-3


class RunawayMeaning(msgspec.Struct, frozen=True):
    """How far one axis runs when the core ends at the worst moment; rad or m."""

    name: str
    rotary: bool
    detection_ms: int
    """The longest silence before its drive reacts."""
    keeps_speed: bool
    """The drive itself holds 6080h; otherwise only its torque bounds the speed."""
    until_noticed_si: float
    distance_si: float
    speed_max_si: float
    from_si: float
    ends_stretched: bool
    """The run ended at the stretched leg, before the ramp did."""
    max_runaway_si: float

    @property
    def is_too_far(self) -> bool:
        """True if the distance is larger than limits.toml allows."""
        return self.distance_si > self.max_runaway_si


def detection_ms(drive: DriveDescription, cycle: Cycle) -> int:
    """The longest silence before a drive reacts: 1016h:01, or 1400h:05 if that is shorter."""
    profile = drive.profile
    watches = (
        (cycle.drive_detection_ms, profile.heartbeat.consumer_entries > 0),
        (cycle.rpdo_timeout_ms, profile.pdo.rpdo_timeout),
    )
    return min(ms for ms, there in watches if there)


def keeps_speed(drive: DriveDescription) -> bool:
    """True if 6080h is written, and not known to be without effect in cyclic torque."""
    written = drive.profile.optional_objects.speed_limit
    return written and drive.profile.torque_mode.speed_limit is not Keeps.NOT_KEPT


def runaway_meanings(settings: Settings) -> tuple[RunawayMeaning, ...]:
    """The runaway of all axes, each leg's hip before its slide."""
    return tuple(meaning for leg in settings.legs for meaning in _meanings(settings, leg))


def runaway_errors(settings: Settings, meanings: tuple[RunawayMeaning, ...]) -> Errors:
    """Torque limits with which the leg goes beyond max_runaway after the core has ended."""
    drives = tuple((leg, axis) for leg in settings.legs for axis in (0, 1))
    for meaning, (leg, axis) in zip(meanings, drives, strict=True):
        if meaning.is_too_far:
            key, value = _torque_limit(settings, axis)
            allowed = _allowed(settings, leg, axis, meaning)
            yield ConfigError(settings.file.limits, key, value, allowed)


def _meanings(settings: Settings, leg: LegDrives) -> Iterator[RunawayMeaning]:
    cycle, drives = settings.trainer.cycle, (leg.hip, leg.slide)
    worst, most = _worst(settings, _axes(settings, leg)), _max_runaway_si(settings)
    for axis, (drive, runaway) in enumerate(zip(drives, worst, strict=True)):
        yield RunawayMeaning(
            name=drive.name,
            rotary=axis == 0,
            detection_ms=detection_ms(drive, cycle),
            keeps_speed=keeps_speed(drive),
            until_noticed_si=runaway.until_noticed_si,
            distance_si=runaway.distance_si,
            speed_max_si=runaway.speed_max_si,
            from_si=runaway.start_si,
            ends_stretched=runaway.ends_stretched,
            max_runaway_si=most[axis],
        )


def _worst(settings: Settings, axes: tuple[AxisRunaway, AxisRunaway]) -> tuple[Runaway, Runaway]:
    leg, gait = leg_parameters(settings.robot), settings.trainer.gait
    poses = workspace.gait_motions(leg, gait, gait.cadence_max_hz, POSES)
    frictions, _ = friction_range(settings.robot, settings.limits)
    return worst_runaways(
        leg,
        frictions,
        [motion.position for motion in poses],
        axes,
        settings.limits.singularity.stop_ratio,
    )


def _axes(settings: Settings, leg: LegDrives) -> tuple[AxisRunaway, AxisRunaway]:
    hip, slide = drive_limits(settings.limits)
    cycle = settings.trainer.cycle
    return axis_runaway(leg.hip, hip, cycle), axis_runaway(leg.slide, slide, cycle)


def axis_runaway(drive: DriveDescription, limits: DriveLimits, cycle: Cycle) -> AxisRunaway:
    """Behaviour of one drive without its master."""
    own_limit_si = limits.velocity_max_si if keeps_speed(drive) else math.inf
    return AxisRunaway(
        effort_max_si=limits.effort_max_si,
        velocity_max_si=limits.velocity_max_si,
        drive_velocity_max_si=own_limit_si,
        deceleration_si_per_s2=limits.quick_stop_deceleration_si_per_s2,
        detection_s=detection_ms(drive, cycle) * _MS,
    )


def _max_runaway_si(settings: Settings) -> Pair:
    limits = settings.limits
    return math.radians(limits.hip.max_runaway_deg), limits.slide.max_runaway_m


def _torque_limit(settings: Settings, axis: int) -> tuple[str, float]:
    if axis == 0:
        return "hip.torque_max_nm", settings.limits.hip.torque_max_nm
    return "slide.force_max_n", settings.limits.slide.force_max_n


def _allowed(settings: Settings, leg: LegDrives, axis: int, found: RunawayMeaning) -> str:
    """The allowed torque limit in words, and why the present one is refused."""
    unit = "N m" if axis == 0 else "N"
    most = _largest_effort(settings, leg, axis)
    far, limit, key = (
        _text(found, found.distance_si),
        _text(found, found.max_runaway_si),
        _KEYS[axis],
    )
    why = (
        f"after the core ends, {found.name} applies its last torque until it stops by itself "
        f"({found.detection_ms} ms and its ramp); the joint moves {far}, {key} allows {limit}"
    )
    if most == 0.0:
        others = "speed limits, ramps and drive_detection_ms keep these values"
        if not found.keeps_speed:
            others = f"{found.name} enforces no speed limit (6080h)"
        return f"no torque limit while {others}: {why}"
    return f"<= {most:.3g} {unit}: {why}"


_KEYS: Final = ("hip.max_runaway_deg", "slide.max_runaway_m")


def _text(meaning: RunawayMeaning, value_si: float) -> str:
    return f"{math.degrees(value_si):.1f} deg" if meaning.rotary else f"{value_si:.3f} m"


def _largest_effort(settings: Settings, leg: LegDrives, axis: int) -> float:
    """The largest torque limit of this axis that stays inside max_runaway; 0: none does."""
    axes, most = _axes(settings, leg), _max_runaway_si(settings)[axis]
    # From above: with too little torque the ramp is less steep and the joint moves farther again.
    for step in range(SEARCH_STEPS - 1, 0, -1):
        effort_si = float(f"{axes[axis].effort_max_si * step / SEARCH_STEPS:.3g}")
        changed = axes[axis]._replace(effort_max_si=effort_si)
        tried = (changed, axes[1]) if axis == 0 else (axes[0], changed)
        if _worst(settings, tried)[axis].distance_si <= most:
            return effort_si
    return 0.0
