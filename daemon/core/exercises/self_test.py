"""Active part of the self-test, mode SELF_TEST: each axis in turn moves a little forth and back.

The axis is guided by the impedance of hold plus the expected friction, at a constant speed beyond
friction's peak. Over the second half of each way the effort exerted, less g(q), is averaged:

    forth    + friction + load error           back    - friction + load error

so half the difference is friction in the middle of the way. Half the sum, less the offset that the
drive is known to show, is the load error relative to the configured leg. No other effort acts: the
speed is constant, and the patient lies relaxed. The test checks

    sign        the joint has moved as its reference, and its effort acts along the motion
    load        within the tolerance of the trainer file
    friction    within the two ratios of what robot.toml has for that speed

Way and direction are chosen before: the first direction whose whole way lies inside the range, its
margins and away from the singularity. The findings are stored with their time (`daily_test.py`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import ClassVar, Final, NamedTuple, Self

import numpy as np
from gaitd_names import Failure, Finding, MotionPhase, ProgressCode, RefusalCode, Stage

from daemon.config.settings import SelfTest as Settings
from daemon.core.core_config import CoreConfig
from daemon.core.exercises.exercise import Exercise, LegSample, LegStart, Reference
from daemon.core.motion.gait_shape import Pair
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Progress, Refusal
from observer.mechanism.friction import at_position, static_friction_of
from observer.mechanism.mechanism import singularity_ratio

RAMP_S: Final = 0.2
"""Time from rest to the speed of the motion, and back."""
REST_S: Final = 0.3
"""Rest at both ends of the way."""
AVERAGED_MIN_S: Final = 0.1
"""Shortest part of a way over which effort is averaged, and shortest time before it at constant
speed, in which spring and friction settle. With 0.05 s the friction of a machine as configured
comes out by up to 1.4 times too large; with 0.1 s it is within a fifth."""
MOVED_RATIO_MIN: Final = 0.4
MOVED_RATIO_MAX: Final = 1.5
"""Allowed motion as a share of the reference way: impedance lags, and friction keeps a part."""
WAY_POINTS: Final = 20


class Way(NamedTuple):
    """Test motion of one axis and its expected efforts; rad and N·m, or m and N."""

    name: str
    """Name of the axis, for example `right/hip`."""
    distance_si: float
    """Signed distance, in the direction in which there is room."""
    speed_si_per_s: float
    friction_si: float
    """Friction from robot.toml at that speed, in the middle of the way."""
    load_tolerance_si: float
    effort_offset_si: float
    """What the drive shows at no effort, from robot.toml."""


class Sums(NamedTuple):
    """Sums of excess effort and motion of one axis, measured during its test."""

    forth_si: float = 0.0
    forth_count: int = 0
    back_si: float = 0.0
    back_count: int = 0
    start_si: float = 0.0
    """Position before the motion."""
    moved_forth_si: float = 0.0
    moved_back_si: float = 0.0


class AxisResult(NamedTuple):
    """The self-test result of one axis."""

    name: str
    friction_si: float
    friction_ratio: float
    load_error_si: float
    moved_si: float
    fault: Finding = Finding.NONE
    """Deviation from the configuration."""
    value: float = 0.0
    limit: float = 0.0


def duration_s(way: Way) -> float:
    """Duration of the test of one axis, including rests."""
    return 2 * (REST_S + _way_s(way))


def total_s(ways: Sequence[Way]) -> float:
    """Duration of the test of one leg: its axes one after the other."""
    return sum(duration_s(way) for way in ways)


def _way_s(way: Way) -> float:
    return abs(way.distance_si) / way.speed_si_per_s + RAMP_S


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfTest(Exercise):
    """The self-test of one leg."""

    legs_in_turn: ClassVar[bool] = True

    start: Pair
    ways: tuple[Way, Way]
    ratios: Pair
    """Lowest and highest allowed friction as a share of the configured one."""
    wait_s: float
    """Time until the legs before this one have been tested."""
    stage: Stage | None = Stage.PREPARING
    sums: tuple[Sums, Sums] = (Sums(), Sums())

    @classmethod
    def may_begin(cls, legs: Sequence[LegStart], config: CoreConfig) -> Refusal | None:
        """Each axis needs room to move a little in one direction."""
        for leg in legs:
            for index, name in enumerate(leg.axis_names):
                if _direction(leg, index, config) == 0.0:
                    return Refusal(RefusalCode.NO_ROOM, name)
        return None

    @classmethod
    def begin(
        cls, legs: Sequence[LegStart], wanted: ModeRequest, config: CoreConfig
    ) -> Sequence[Exercise]:
        """The test of each axis of each leg in turn."""
        del wanted
        rules = config.self_test
        ways = [(_way(leg, 0, config), _way(leg, 1, config)) for leg in legs]
        waits_s = accumulate((total_s(one) for one in ways), initial=0.0)
        return [
            cls(
                start=leg.pose,
                ways=its_ways,
                ratios=(rules.friction_min_ratio, rules.friction_max_ratio),
                wait_s=wait_s,
            )
            for leg, its_ways, wait_s in zip(legs, ways, waits_s, strict=False)
        ]

    def advance(self, leg: LegSample, dt_s: float) -> Self:
        """See `Exercise`; it begins once both drives are in torque mode."""
        if self.stage is Stage.OVER:
            return self
        later = replace(self, elapsed_s=self.elapsed_s + dt_s)
        if later.stage is Stage.PREPARING:
            return later.begun_in_torque_mode(leg, self.wait_s)
        hip, slide = (
            _summed(self.sums[index], leg, index, *later.phase(index)) for index in (0, 1)
        )
        if later.stage is Stage.PLAYING and later.elapsed_s >= total_s(self.ways):
            return replace(later, stage=Stage.OVER, elapsed_s=0.0, sums=(hip, slide))
        return replace(later, sums=(hip, slide))

    def targets(self, leg: LegSample) -> Reference:
        """One axis on its way, the other where it began."""
        del leg
        moved = [self._moved(index) for index in (0, 1)]
        position = self.start[0] + moved[0][0], self.start[1] + moved[1][0]
        # Feedforward of friction: with the spring alone the leg would lag, twice at each turn.
        hip_nm, slide_n = (
            way.friction_si * one[1] / way.speed_si_per_s
            for way, one in zip(self.ways, moved, strict=True)
        )
        return Reference(position, (moved[0][1], moved[1][1]), (hip_nm, slide_n), guided=True)

    def progress(self) -> Progress | None:
        """The axis under test and its phase."""
        if self.stage is not Stage.PLAYING:
            return Exercise.progress(self)
        phases = [self.phase(index)[0] for index in (0, 1)]
        index = 0 if phases[0] is not MotionPhase.DONE else 1
        return Progress(ProgressCode.TESTING, self.ways[index].name, (phases[index],))

    def results(self) -> tuple[AxisResult, AxisResult]:
        """The results of the finished test, for hip and slide."""
        hip, slide = (
            _result(way, sums, self.ratios, self.failure)
            for way, sums in zip(self.ways, self.sums, strict=True)
        )
        return hip, slide

    def phase(self, index: int) -> tuple[MotionPhase, bool]:
        """The phase of an axis, and whether its effort is averaged now."""
        way = self.ways[index]
        since_s = self.elapsed_s - (duration_s(self.ways[0]) if index else 0.0)
        way_s = _way_s(way)
        counts_from_s = REST_S + 0.5 * way_s
        if since_s < REST_S:
            return MotionPhase.REST, False
        if since_s < REST_S + way_s:
            return MotionPhase.FORTH, counts_from_s <= since_s < REST_S + way_s - RAMP_S
        if since_s < 2 * REST_S + way_s:
            return MotionPhase.TURN, False
        back_s = since_s - REST_S - way_s
        if back_s < REST_S + way_s:
            return MotionPhase.BACK, counts_from_s <= back_s < REST_S + way_s - RAMP_S
        return MotionPhase.DONE, False

    def _moved(self, index: int) -> Pair:
        """Distance and speed of one axis's reference."""
        if self.stage is not Stage.PLAYING:
            return 0.0, 0.0
        way = self.ways[index]
        since_s = self.elapsed_s - (duration_s(self.ways[0]) if index else 0.0)
        forth = _ramped(way, since_s - REST_S)
        back = _ramped(way, since_s - 2 * REST_S - _way_s(way))
        return forth[0] - back[0], forth[1] - back[1]


def _way(leg: LegStart, index: int, config: CoreConfig) -> Way:
    rules = config.self_test
    speed_si = speeds(rules)[index]
    distance_si = _direction(leg, index, config) * distances(rules)[index]
    middle_si = leg.pose[index] + distance_si / 2
    law = at_position(leg.friction[index], leg.over[index], middle_si)
    return Way(
        name=leg.axis_names[index],
        distance_si=distance_si,
        speed_si_per_s=speed_si,
        friction_si=static_friction_of(law, speed_si),
        load_tolerance_si=load_tolerances(rules)[index],
        effort_offset_si=leg.effort_offset[index],
    )


def _direction(leg: LegStart, index: int, config: CoreConfig) -> float:
    """Sign of the first direction with room for the whole way of one axis; 0 if there is none."""
    distance_si = distances(config.self_test)[index]
    start = leg.pose
    for sign in (1.0, -1.0):
        parts = (sign * distance_si * k / WAY_POINTS for k in range(WAY_POINTS + 1))
        moved = (
            (start[0] + p, start[1]) if index == 0 else (start[0], start[1] + p) for p in parts
        )
        if all(_has_room(leg, pose, config) for pose in moved):
            return sign
    return 0.0


def _has_room(leg: LegStart, pose: Pair, config: CoreConfig) -> bool:
    inside = all(
        limits.position_min_si + limits.soft_margin_si
        <= position_si
        <= limits.position_max_si - limits.soft_margin_si
        for limits, position_si in zip(leg.limits, pose, strict=True)
    )
    smallest = config.thresholds.singularity_stop_ratio
    return inside and float(singularity_ratio(leg.parameters, np.array(pose))) > smallest


def _summed(sums: Sums, leg: LegSample, index: int, phase: MotionPhase, counts: bool) -> Sums:
    if not leg.fresh[index]:
        return sums
    position_si, excess_si = leg.position[index], leg.excess[index]
    if phase is MotionPhase.REST:
        return sums._replace(start_si=position_si)
    if phase is MotionPhase.TURN:
        return sums._replace(moved_forth_si=position_si - sums.start_si)
    if phase is MotionPhase.BACK:
        back_si = position_si - sums.start_si - sums.moved_forth_si
        sums = sums._replace(moved_back_si=back_si)
        if counts:
            return sums._replace(back_si=sums.back_si + excess_si, back_count=sums.back_count + 1)
    elif phase is MotionPhase.FORTH and counts:
        return sums._replace(forth_si=sums.forth_si + excess_si, forth_count=sums.forth_count + 1)
    return sums


def _ramped(way: Way, since_s: float) -> Pair:
    """Distance and speed after a time on the way; speed ramps linearly, so effort never steps.

    The ramps must not overlap: way / speed >= RAMP_S, which `speed_max` sees to.
    """
    way_s, speed_si = _way_s(way), math.copysign(way.speed_si_per_s, way.distance_si)
    if since_s <= 0.0:
        return 0.0, 0.0
    if since_s >= way_s:
        return way.distance_si, 0.0
    left_s = way_s - since_s
    if since_s < RAMP_S:
        return 0.5 * speed_si * since_s**2 / RAMP_S, speed_si * since_s / RAMP_S
    if left_s < RAMP_S:
        return way.distance_si - 0.5 * speed_si * left_s**2 / RAMP_S, speed_si * left_s / RAMP_S
    return speed_si * (since_s - 0.5 * RAMP_S), speed_si


def _result(way: Way, sums: Sums, ratios: Pair, failure: Failure) -> AxisResult:
    if not sums.forth_count or not sums.back_count:
        fault = Finding.NO_SAMPLE if failure is Failure.NONE else Finding.NOT_BEGUN
        return AxisResult(way.name, 0.0, 0.0, 0.0, 0.0, fault)
    forth_si, back_si = sums.forth_si / sums.forth_count, sums.back_si / sums.back_count
    along = math.copysign(1.0, way.distance_si)
    friction_si = along * (forth_si - back_si) / 2
    result = AxisResult(
        name=way.name,
        friction_si=friction_si,
        friction_ratio=friction_si / way.friction_si,
        load_error_si=(forth_si + back_si) / 2 - way.effort_offset_si,
        moved_si=sums.moved_forth_si,
    )
    fault, value, limit = _fault(way, sums, result, ratios)
    return result._replace(fault=fault, value=value, limit=limit)


def _fault(way: Way, sums: Sums, result: AxisResult, ratios: Pair) -> tuple[Finding, float, float]:
    """The gravest deviation from the configuration, its value and its limit."""
    for fault, moved_si, wanted_si in (
        (Finding.NOT_MOVED_FORTH, sums.moved_forth_si, way.distance_si),
        (Finding.NOT_MOVED_BACK, sums.moved_back_si, -way.distance_si),
    ):
        if not MOVED_RATIO_MIN <= moved_si / wanted_si <= MOVED_RATIO_MAX:
            return fault, moved_si, wanted_si
    if result.friction_si <= 0:
        return Finding.ACTS_AGAINST_MOTION, result.friction_si, way.friction_si
    if abs(result.load_error_si) > way.load_tolerance_si:
        return Finding.LOAD_OF_ANOTHER_LEG, result.load_error_si, way.load_tolerance_si
    low_ratio, high_ratio = ratios
    if result.friction_ratio < low_ratio:
        return Finding.FRICTION_LESS, result.friction_ratio, low_ratio
    if result.friction_ratio > high_ratio:
        return Finding.FRICTION_MORE, result.friction_ratio, high_ratio
    return Finding.NONE, 0.0, 0.0


def distances(rules: Settings) -> Pair:
    """Test distances of hip and slide: rad, m."""
    return math.radians(rules.hip.motion_deg), rules.slide.motion_m


def speeds(rules: Settings) -> Pair:
    """Test speeds of hip and slide: rad/s, m/s."""
    return rules.hip.speed_rad_per_s, rules.slide.speed_m_per_s


def speed_max(distance_si: float) -> float:
    """Highest allowed speed of a test over a distance, rad/s or m/s: what averaging needs.

    A way lasts for distance / speed + RAMP_S. Its second half less the ramp is averaged, and its
    first half less the ramp is as long. So (distance / speed - RAMP_S) / 2 >= AVERAGED_MIN_S, and

        speed <= distance / (RAMP_S + 2 AVERAGED_MIN_S)

    rounded down to 0.001, so that the number in the text of a refusal is itself allowed.
    """
    most_si_per_s = distance_si / (RAMP_S + 2 * AVERAGED_MIN_S)
    return math.floor(1e3 * most_si_per_s + 1e-6) / 1e3  # 0.04 m / 0.4 s is 0.1, not 0.099


def load_tolerances(rules: Settings) -> Pair:
    """Tolerances of the load error of hip and slide: N·m, N."""
    return rules.hip.load_tolerance_nm, rules.slide.load_tolerance_n
