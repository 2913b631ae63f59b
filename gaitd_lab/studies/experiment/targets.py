"""The targets that the rows of the experiment are held against.

A target is met if every seed meets it. TARGETS is the only place of their numbers. Those of section
3.2 of the observer's design were set beside one draw of a prototype, those of section 7 are limits
of its test cases.
"""

from collections.abc import Sequence
from enum import Enum
from typing import Final, NamedTuple

from gaitd_lab.studies.experiment.measures import Number, Row
from gaitd_lab.studies.report import rounded

Pair = tuple[float, float]


class Plant(Enum):
    """Friction of the plant, by its relation to the observer's law."""

    MATCHED = "the observer's law"
    STICKING = "ideal sticking"
    BRISTLES = "bristles (LuGre)"


class Scale(Enum):
    """Unit of a target's limits."""

    ONE = ""
    """The unit of the row."""
    COULOMB = "of the Coulomb level"
    DISTURBANCE = "of the disturbance's peak"


class Scales(NamedTuple):
    """Sizes that relative targets refer to; pairs are hip and slide."""

    coulomb: Pair
    disturbance: Pair

    def of(self, scale: Scale) -> Pair:
        """Factors from limits of this scale to the unit of the row."""
        factors = {Scale.COULOMB: self.coulomb, Scale.DISTURBANCE: self.disturbance}
        return factors.get(scale, (1.0, 1.0))


class Target(NamedTuple):
    """Limits of a row; None: the axis has no target."""

    row: str
    kind: str
    """`≤`, `≥`, or `±`: the size is at most the limit."""
    limits: tuple[float | None, float | None]
    """Hip and slide, in `scale`."""
    source: str
    plants: tuple[Plant, ...] = (Plant.MATCHED, Plant.BRISTLES)
    scale: Scale = Scale.ONE


_M, _B = (Plant.MATCHED,), (Plant.BRISTLES,)
TARGETS: Final = (
    Target("velocity peak, difference", "±", (2.0, None), "design 7, case 21"),
    Target("velocity peak, lag", "±", (1.0, None), "design 7, case 21"),
    # Half an encoder quantum of the prototype, 1e-4 rad and 5e-5 m; here it is 6.1e-5 and 4.9e-5.
    Target("position, rms error", "≤", (50.0, 25.0), "design 3.2"),
    Target("velocity, rms error", "≤", (4.0, 2.0), "design 3.2"),
    Target("velocity, times better than differences", "≥", (3.0, 3.0), "design 3.2"),
    Target("friction, rms error in motion", "≤", (0.01, 0.01), "design 3.2", _M, Scale.COULOMB),
    Target("friction, rms error in motion", "≤", (0.06, 0.06), "design 3.2", _B, Scale.COULOMB),
    Target(
        "disturbance, rms error in motion", "≤", (0.05, 0.05), "design 3.2", _M, Scale.DISTURBANCE
    ),
    Target(
        "disturbance, rms error in motion", "≤", (0.12, 0.12), "design 3.2", _B, Scale.DISTURBANCE
    ),
    Target("net effort, rms error", "≤", (0.2, 2.0), "design 3.2", _M),
    Target("step at rest: 90 % after motion", "≤", (None, 100.0), "design 7, case 20"),
    Target("step gone in motion: 90 % after", "≤", (None, 60.0), "design 3.2"),
    Target("cross talk from the other axis", "≤", (0.25, 2.0), "design 3.2"),
)


class Judged(NamedTuple):
    """A target of a row, and how many seeds met it."""

    words: str
    """The limits, in the unit of the row."""
    met_count: int
    seed_count: int

    @property
    def met(self) -> bool:
        """True if every seed met it."""
        return self.met_count == self.seed_count

    def __str__(self) -> str:
        """Say whether it is met."""
        missed = self.seed_count - self.met_count
        return "met" if self.met else f"missed by {missed} of {self.seed_count}"


def judge(target: Target, same: Sequence[Row], scales: Scales) -> Judged | None:
    """Hold the same row of several seeds against a target.

    None if the scenario ended before it had what the target needs.
    """
    if all(row.hip is None and row.slide is None for row in same):
        return None
    limits = [
        None if limit is None else limit * factor
        for limit, factor in zip(target.limits, scales.of(target.scale), strict=True)
    ]
    known = [limit for limit in limits if limit is not None]
    if target.scale is not Scale.ONE and 0.0 in known:
        return None  # nothing to refer to: the disturbance has not begun
    met = sum(
        all(
            _within(value, limit, target.kind)
            for value, limit in zip((row.hip, row.slide), limits, strict=True)
            if limit is not None
        )
        for row in same
    )
    return Judged(f"{target.kind} {', '.join(map(rounded, known))}", met, len(same))


def _within(value: Number, limit: float, kind: str) -> bool:
    if value is None:
        return False
    return value >= limit if kind == "≥" else abs(value) <= limit if kind == "±" else value <= limit
