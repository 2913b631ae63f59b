"""Errors of the estimate: each span of the demonstration against its bounds.

Only published valid estimates are evaluated. At rest the split between friction and patient cannot
be observed, and the service publishes null: that counts as coverage, not as error. The reference is
the true patient plus the artificial disturbance, which the observer must estimate as one.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from gaitd_client import wire
from numpy.typing import NDArray

from analysis.accuracy import Score, nearest, score
from gaitd_lab.demonstration.feed import LegTracks
from gaitd_lab.demonstration.script import Kind
from gaitd_lab.studies.report import UNKNOWN, Table

MATCH_NS: Final = 5_000_000
"""Half a cycle: an estimate and a truth further apart belong to different SYNCs."""


class Bound(NamedTuple):
    """Bounds of a span."""

    rms: tuple[float, float]
    """Largest rms of the hip, N·m, and the slide, N."""
    correlation_min: float
    """-1 disables the bound: a constant truth has no correlation."""
    covered_min_ratio: float
    """Required share of cycles with a valid estimate."""


BOUNDS: Final = {
    Kind.PASSIVE: Bound((0.3, 2.0), -1.0, 0.2),
    Kind.ACTIVE: Bound((0.6, 3.0), 0.98, 0.7),
    Kind.TIRING: Bound((0.6, 6.0), 0.9, 0.6),
    Kind.OPEN_LOOP: Bound((0.6, 3.0), -1.0, 0.4),
}
"""The passive span begins with a ramp from rest; the paper's experiment rests at its reversals.
The patient who tires pushes with up to 200 N at the slide, five times as much as the active one."""


class Span(NamedTuple):
    """A period of time that is evaluated."""

    title: str
    kind: Kind
    begin_ns: int
    end_ns: int


class Row(NamedTuple):
    """One axis in one span."""

    span: Span
    axis: str
    """As `axis_title`."""
    unit: str
    score: Score
    rms_bound: float
    correlation_min: float
    covered_min_ratio: float

    @property
    def passed(self) -> bool:
        """True if everything is within its bound; false without samples."""
        found = self.score
        correlated = self.correlation_min <= -1.0 or found.correlation >= self.correlation_min
        return (
            found.sample_count > 0
            and found.rms <= self.rms_bound
            and correlated
            and found.covered_ratio >= self.covered_min_ratio
        )


class Pair(NamedTuple):
    """Estimate and reference of one axis, at the same instants."""

    time_ns: NDArray[np.int64]
    estimate: NDArray[np.float64]
    std: NDArray[np.float64]
    wanted: NDArray[np.float64]
    friction: NDArray[np.float64]
    true_friction: NDArray[np.float64]


Pairs = Mapping[str, tuple[Pair, Pair]]
"""Hip and slide, by leg."""


class Walk(NamedTuple):
    """Strides of an act."""

    strides: Sequence[wire.Stride]
    helps: Sequence[wire.ControllerState]
    """Empty without help."""


class Results(NamedTuple):
    """What a demonstration was."""

    pairs: Pairs
    spans: Sequence[Span]
    rows: Sequence[Row]
    health: Sequence[wire.Health]
    """The last lateness of each act; only with the computer's clock, simulated time has none."""
    trouble: str
    """Reason of an early end; empty if it was complete."""
    walks: Sequence[Walk] = ()
    """Strides of each act."""

    @property
    def passed(self) -> bool:
        """True if all errors are within bounds, nothing stopped, and something was evaluated."""
        return not self.trouble and bool(self.rows) and all(row.passed for row in self.rows)


AXES: Final = (("hip", "nm", "N·m"), ("slide", "n", "N"))
"""Name, suffix of the fields, displayed unit."""


def axis_title(leg: str, axis: str, legs: Pairs) -> str:
    """Return an axis' name, with its leg where there are several."""
    return axis if len(legs) == 1 else f"{leg} {axis}"


def pairs(legs: Mapping[str, LegTracks], newest: int = 0) -> Pairs:
    """Return hip and slide of each leg: estimates with their references; NaN where one is missing.

    Args:
        legs: what is known of each.
        newest: number of newest rows; 0 means all.
    """
    return {leg: _pairs_of(tracks, newest) for leg, tracks in legs.items()}


def _pairs_of(tracks: LegTracks, newest: int) -> tuple[Pair, Pair]:
    received, true = tracks
    received_ns, said = received.arrays(newest)
    true_ns, truth = true.arrays(newest)
    index = nearest(received_ns, true_ns, MATCH_NS)
    found = np.full((len(index), len(true.columns)), math.nan)
    found[index >= 0] = truth[index[index >= 0]]
    hip, slide = (
        Pair(
            received_ns,
            received.column(f"{axis}_patient_{suffix}", said),
            received.column(f"{axis}_patient_{suffix}_std", said),
            true.column(f"{axis}_patient_{suffix}", found)
            + np.nan_to_num(received.column(f"artificial_{axis}_{suffix}", said)),
            received.column(f"{axis}_friction_{suffix}", said),
            true.column(f"{axis}_friction_{suffix}", found),
        )
        for axis, suffix, _ in AXES
    )
    return hip, slide


def evaluate(spans: Sequence[Span], legs: Pairs) -> tuple[Row, ...]:
    """Evaluate both axes of each leg in every span that has bounds."""
    return tuple(
        _row(span, pair, index, axis_title(leg, AXES[index][0], legs))
        for span in spans
        if span.kind in BOUNDS
        for leg, both in legs.items()
        for index, pair in enumerate(both)
    )


def _row(span: Span, pair: Pair, index: int, axis: str) -> Row:
    inside = (pair.time_ns >= span.begin_ns) & (pair.time_ns < span.end_ns)
    _, _, unit = AXES[index]
    bound, found = BOUNDS[span.kind], score(pair.estimate[inside], pair.wanted[inside])
    rms_bound = bound.rms[index]
    return Row(span, axis, unit, found, rms_bound, bound.correlation_min, bound.covered_min_ratio)


def errors(rows: Sequence[Row]) -> Table:
    """Return the errors of each axis in each span, with their bounds."""
    head = (
        *("span", "axis", "rms error", "at most", "worst", "bias"),
        *("correlation", "not below", "valid", "at least", ""),
    )
    return Table("estimate against truth", head, [_cells(row) for row in rows])


def _cells(row: Row) -> tuple[str, ...]:
    found = row.score
    return (
        row.span.title,
        row.axis,
        f"{found.rms:.2f} {row.unit}",
        f"{row.rms_bound:g}",
        f"{found.worst:.2f}",
        f"{found.bias:.2f}",
        # A constant truth has no correlation.
        UNKNOWN if row.span.kind is Kind.PASSIVE else f"{found.correlation:.4f}",
        f"{row.correlation_min:g}" if row.correlation_min > -1 else "",
        f"{found.covered_ratio:.0%}",
        f"{row.covered_min_ratio:.0%}",
        "✔" if row.passed else "✘",
    )
