"""Active part of the self-test, mode SELF_TEST: each axis in turn moves a little forth and back.

The axis is guided by the impedance of hold plus the expected friction, at a constant speed beyond
friction's peak. Over the second half of each way the effort exerted, less g(q), is averaged:

    forth    + friction + load error           back    - friction + load error

so half the difference is friction, and half the sum is the load error relative to the configured
leg. No other effort acts: the speed is constant, and the patient lies relaxed. The test checks

    sign        the joint has moved as its reference, and its effort acts along the motion
    load        within the tolerance of the trainer file
    friction    within the two ratios of what robot.toml has for that speed

Way and direction are chosen before: the first direction whose whole way lies inside the range, its
margins and away from the singularity. The findings are stored with their time (`daily_test.py`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final, NamedTuple

from daemon.config.settings import SelfTest
from daemon.core.motion.trajectory import Pair, Reference
from daemon.ipc.record import Stage

RAMP_S: Final = 0.2
"""Time from rest to the speed of the motion, and back."""
REST_S: Final = 0.3
"""Rest at both ends of the way."""
BEGIN_MAX_S: Final = 20.0
"""Longest wait for torque mode; a leg that is kept moving is not tested."""
MOVED_RATIO_MIN: Final = 0.4
MOVED_RATIO_MAX: Final = 1.5
"""Allowed motion as a share of the reference way: impedance lags, and friction keeps a part."""


class Phase(Enum):
    """Phase of the motion of one axis."""

    REST = "at rest"
    FORTH = "forth"
    TURN = "turning"
    BACK = "back"
    DONE = "done"


class Way(NamedTuple):
    """Test motion of one axis and its expected efforts; rad and N·m, or m and N."""

    name: str
    """Name of the axis, for example `right/hip`."""
    distance_si: float
    """Signed distance, in the direction in which there is room."""
    speed_si_per_s: float
    friction_si: float
    """Friction from robot.toml at that speed."""
    load_tolerance_si: float


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


class Seen(NamedTuple):
    """Measured values of one axis in one cycle."""

    fresh: bool
    position_si: float
    excess_si: float
    """Effort exerted, less g(q)."""


class Finding(NamedTuple):
    """The self-test result of one axis."""

    name: str
    friction_si: float
    friction_ratio: float
    load_error_si: float
    moved_si: float
    fault: str = ""
    """Deviation from the configuration; empty if there is none."""
    value: float = 0.0
    limit: float = 0.0


@dataclass(frozen=True, slots=True)
class SelfTestPlay:
    """The self-test plan of one leg."""

    start: Pair
    ways: tuple[Way, Way]
    ratios: Pair
    """Lowest and highest allowed friction as a share of the configured one."""
    wait_s: float
    """Time until the legs before this one have been tested."""
    stage: Stage = Stage.PREPARING
    elapsed_s: float = 0.0
    """Time in the stage."""
    sums: tuple[Sums, Sums] = (Sums(), Sums())


def duration_s(way: Way) -> float:
    """Duration of the test of one axis, including rests."""
    return 2 * (REST_S + _way_s(way))


def total_s(ways: Sequence[Way]) -> float:
    """Duration of the test of one leg: its axes one after the other."""
    return sum(duration_s(way) for way in ways)


def _way_s(way: Way) -> float:
    return abs(way.distance_si) / way.speed_si_per_s + RAMP_S


def advance_self_test(
    play: SelfTestPlay, dt_s: float, seen: tuple[Seen, Seen], *, ready: bool
) -> SelfTestPlay:
    """Advance the test by one cycle; `ready`: the drives are in torque mode."""
    if play.stage == Stage.OVER:
        return play
    play = replace(play, elapsed_s=play.elapsed_s + dt_s)
    if play.stage == Stage.PREPARING:
        if ready and play.elapsed_s >= play.wait_s:
            return replace(play, stage=Stage.PLAYING, elapsed_s=0.0)
        late = play.elapsed_s >= play.wait_s + BEGIN_MAX_S
        return replace(play, stage=Stage.OVER, elapsed_s=0.0) if late else play
    hip, slide = (_looked(play.sums[index], seen[index], *_turn(play, index)) for index in range(2))
    play = replace(play, sums=(hip, slide))
    if play.stage == Stage.PLAYING and play.elapsed_s >= total_s(play.ways):
        return replace(play, stage=Stage.OVER, elapsed_s=0.0)
    return play


def progress(play: SelfTestPlay) -> str:
    """Text with the axis under test and its phase, for example `right/hip forth`."""
    phases = [_turn(play, index)[0] for index in range(2)]
    index = 0 if phases[0] is not Phase.DONE else 1
    return f"{play.ways[index].name} {phases[index].value}"


def _turn(play: SelfTestPlay, index: int) -> tuple[Phase, bool]:
    """The phase of an axis, and whether its effort is averaged now."""
    way = play.ways[index]
    since_s = play.elapsed_s - (duration_s(play.ways[0]) if index else 0.0)
    way_s = _way_s(way)
    counts_from_s = REST_S + 0.5 * way_s
    if since_s < REST_S:
        return Phase.REST, False
    if since_s < REST_S + way_s:
        return Phase.FORTH, counts_from_s <= since_s < REST_S + way_s - RAMP_S
    if since_s < 2 * REST_S + way_s:
        return Phase.TURN, False
    back_s = since_s - REST_S - way_s
    if back_s < REST_S + way_s:
        return Phase.BACK, counts_from_s <= back_s < REST_S + way_s - RAMP_S
    return Phase.DONE, False


def _looked(sums: Sums, seen: Seen, phase: Phase, counts: bool) -> Sums:
    if not seen.fresh:
        return sums
    if phase is Phase.REST:
        return sums._replace(start_si=seen.position_si)
    if phase is Phase.TURN:
        return sums._replace(moved_forth_si=seen.position_si - sums.start_si)
    if phase is Phase.BACK:
        back_si = seen.position_si - sums.start_si - sums.moved_forth_si
        sums = sums._replace(moved_back_si=back_si)
        if counts:
            return sums._replace(
                back_si=sums.back_si + seen.excess_si, back_count=sums.back_count + 1
            )
    elif phase is Phase.FORTH and counts:
        return sums._replace(
            forth_si=sums.forth_si + seen.excess_si, forth_count=sums.forth_count + 1
        )
    return sums


def self_test_reference(play: SelfTestPlay) -> Reference:
    """Reference of the leg: one axis on its way, the other where it began."""
    moved = [_moved(play, index, play.elapsed_s) for index in range(2)]
    position = play.start[0] + moved[0][0], play.start[1] + moved[1][0]
    # Feedforward of friction: with the spring alone the leg would lag, twice as far at each turn.
    hip_nm, slide_n = (
        way.friction_si * one[1] / way.speed_si_per_s
        for way, one in zip(play.ways, moved, strict=True)
    )
    return Reference(position, (moved[0][1], moved[1][1]), (hip_nm, slide_n), guided=True)


def _moved(play: SelfTestPlay, index: int, elapsed_s: float) -> Pair:
    """Distance and speed of one axis's reference."""
    if play.stage != Stage.PLAYING:
        return 0.0, 0.0
    way = play.ways[index]
    since_s = elapsed_s - (duration_s(play.ways[0]) if index else 0.0)
    forth = _ramped(way, since_s - REST_S)
    back = _ramped(way, since_s - 2 * REST_S - _way_s(way))
    return forth[0] - back[0], forth[1] - back[1]


def _ramped(way: Way, since_s: float) -> Pair:
    """Distance and speed after a time on the way; speed ramps linearly, so effort never steps."""
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


def findings(play: SelfTestPlay) -> tuple[Finding, Finding]:
    """The results of the test of one leg, for hip and slide."""
    hip, slide = (
        _finding(way, sums, play.ratios) for way, sums in zip(play.ways, play.sums, strict=True)
    )
    return hip, slide


def _finding(way: Way, sums: Sums, ratios: Pair) -> Finding:
    if not sums.forth_count or not sums.back_count:
        return Finding(way.name, 0.0, 0.0, 0.0, 0.0, "no sample came while it moved")
    forth_si, back_si = sums.forth_si / sums.forth_count, sums.back_si / sums.back_count
    along = math.copysign(1.0, way.distance_si)
    friction_si = along * (forth_si - back_si) / 2
    found = Finding(
        name=way.name,
        friction_si=friction_si,
        friction_ratio=friction_si / way.friction_si,
        load_error_si=(forth_si + back_si) / 2,
        moved_si=sums.moved_forth_si,
    )
    fault, value, limit = _fault(way, sums, found, ratios)
    return found._replace(fault=fault, value=value, limit=limit)


def _fault(way: Way, sums: Sums, found: Finding, ratios: Pair) -> tuple[str, float, float]:
    """The gravest deviation from the configuration, its value and its limit."""
    for word, moved_si, wanted_si in (
        ("forth", sums.moved_forth_si, way.distance_si),
        ("back", sums.moved_back_si, -way.distance_si),
    ):
        if not MOVED_RATIO_MIN <= moved_si / wanted_si <= MOVED_RATIO_MAX:
            return f"sign: it did not move {word} as it was guided", moved_si, wanted_si
    if found.friction_si <= 0:
        return "sign: its effort acts against its motion", found.friction_si, way.friction_si
    if abs(found.load_error_si) > way.load_tolerance_si:
        return "static load: not that of the leg", found.load_error_si, way.load_tolerance_si
    low_ratio, high_ratio = ratios
    if found.friction_ratio < low_ratio:
        return "friction: less than it was", found.friction_ratio, low_ratio
    if found.friction_ratio > high_ratio:
        return "friction: more than it was", found.friction_ratio, high_ratio
    return "", 0.0, 0.0


def said(found: Finding) -> str:
    """One line of text with the results of an axis."""
    unit = "N·m" if found.name.endswith("hip") else "N"
    numbers = (
        f"friction {found.friction_si:.3g} {unit} ({found.friction_ratio:.2f} of the configured), "
        f"load off by {found.load_error_si:.3g} {unit}"
    )
    return f"{found.name}: self-test {found.fault or 'passed'}: {numbers}"


def distances(rules: SelfTest) -> Pair:
    """Test distances of hip and slide: rad, m."""
    return math.radians(rules.hip_motion_deg), rules.slide_motion_m


def speeds(rules: SelfTest) -> Pair:
    """Test speeds of hip and slide: rad/s, m/s."""
    return rules.hip_speed_rad_per_s, rules.slide_speed_m_per_s


def load_tolerances(rules: SelfTest) -> Pair:
    """Tolerances of the load error of hip and slide: N·m, N."""
    return rules.hip_load_tolerance_nm, rules.slide_load_tolerance_n
