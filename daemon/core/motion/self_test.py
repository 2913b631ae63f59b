"""The active part of the self-test, mode SELF_TEST: each axis in turn a little forth and back.

Guided by the impedance of hold and what friction should need, at a constant speed that is beyond
friction's peak. Over the second half of each way the effort exerted, less g(q), is averaged:

    forth    + friction + load error           back    - friction + load error

so half the difference is friction, half the sum is what the load differs from the configured leg.
Nothing else acts: the speed is constant, and the patient lies relaxed. Found is

    sign        the joint has moved as its reference, and its effort acts along the motion
    load        within the tolerance of the trainer file
    friction    within the two ratios of what robot.toml has for that speed

Way and direction are chosen before: the first direction whose whole way lies inside the range, its
margins and away from the singularity. What this finds is noted with its time (`daily_test.py`).
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
"""From rest to the speed of the motion, and back."""
REST_S: Final = 0.3
"""At both ends of the way."""
BEGIN_MAX_S: Final = 20.0
"""A leg that somebody keeps moving is not tested."""
MOVED_RATIO_MIN: Final = 0.4
MOVED_RATIO_MAX: Final = 1.5
"""Of the way of the reference: a spring and a damper lag, and friction keeps some of it."""


class Phase(Enum):
    """What an axis does while it is its turn."""

    REST = "at rest"
    FORTH = "forth"
    TURN = "turning"
    BACK = "back"
    DONE = "done"


class Way(NamedTuple):
    """How one axis is moved, and what is expected of it; rad and N·m, or m and N."""

    name: str
    """`right/hip`."""
    distance_si: float
    """Signed: the direction in which there is room."""
    speed_si_per_s: float
    friction_si: float
    """Of robot.toml at that speed."""
    load_tolerance_si: float


class Sums(NamedTuple):
    """What one axis showed."""

    forth_si: float = 0.0
    forth_count: int = 0
    back_si: float = 0.0
    back_count: int = 0
    start_si: float = 0.0
    """Position before it began."""
    moved_forth_si: float = 0.0
    moved_back_si: float = 0.0


class Seen(NamedTuple):
    """One axis in one cycle."""

    fresh: bool
    position_si: float
    excess_si: float
    """Effort exerted, less g(q)."""


class Finding(NamedTuple):
    """The result for one axis."""

    name: str
    friction_si: float
    friction_ratio: float
    load_error_si: float
    moved_si: float
    fault: str = ""
    """What is not as configured; empty if all is."""
    value: float = 0.0
    limit: float = 0.0


@dataclass(frozen=True, slots=True)
class SelfTestPlay:
    """The test of one leg."""

    start: Pair
    ways: tuple[Way, Way]
    ratios: Pair
    """Friction may be this part of the configured one, least and most."""
    wait_s: float
    """Until the legs before have been tested."""
    stage: Stage = Stage.PREPARING
    elapsed_s: float = 0.0
    """In the stage."""
    sums: tuple[Sums, Sums] = (Sums(), Sums())


def duration_s(way: Way) -> float:
    """Of one axis, rests and all."""
    return 2 * (REST_S + _way_s(way))


def total_s(ways: Sequence[Way]) -> float:
    """Of one leg: its axes one after the other."""
    return sum(duration_s(way) for way in ways)


def _way_s(way: Way) -> float:
    return abs(way.distance_si) / way.speed_si_per_s + RAMP_S


def advance_self_test(
    play: SelfTestPlay, dt_s: float, seen: tuple[Seen, Seen], *, ready: bool
) -> SelfTestPlay:
    """One cycle on; `ready`: the drives are in torque mode."""
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
    """Which axis does what: `right/hip forth`."""
    phases = [_turn(play, index)[0] for index in range(2)]
    index = 0 if phases[0] is not Phase.DONE else 1
    return f"{play.ways[index].name} {phases[index].value}"


def _turn(play: SelfTestPlay, index: int) -> tuple[Phase, bool]:
    """What an axis does now, and whether its effort counts."""
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
    """Where the leg is wanted: one axis on its way, the other where it began."""
    moved = [_moved(play, index, play.elapsed_s) for index in range(2)]
    position = play.start[0] + moved[0][0], play.start[1] + moved[1][0]
    # The spring of hold alone would lag by what friction needs, twice at each turn.
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
    """On the way for so long: speed rises and falls linearly, so effort never steps."""
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
    """What the test of one leg has found."""
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
    """What is not as configured, its value and the limit; the gravest first."""
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
    """One line with the numbers of an axis."""
    unit = "N·m" if found.name.endswith("hip") else "N"
    numbers = (
        f"friction {found.friction_si:.3g} {unit} ({found.friction_ratio:.2f} of the configured), "
        f"load off by {found.load_error_si:.3g} {unit}"
    )
    return f"{found.name}: self-test {found.fault or 'passed'}: {numbers}"


def distances(rules: SelfTest) -> Pair:
    """How far hip and slide are moved: rad, m."""
    return math.radians(rules.hip_motion_deg), rules.slide_motion_m


def speeds(rules: SelfTest) -> Pair:
    """How fast hip and slide are moved: rad/s, m/s."""
    return rules.hip_speed_rad_per_s, rules.slide_speed_m_per_s


def load_tolerances(rules: SelfTest) -> Pair:
    """N·m, N."""
    return rules.hip_load_tolerance_nm, rules.slide_load_tolerance_n
