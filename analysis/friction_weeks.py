"""Friction of many self-tests by trainer and week, and its trend, merged by DuckDB.

A week is one of ISO 8601, from Monday, in UTC. A week's interval comes from the spread of its
self-tests, because temperature and the person in the machine differ more from test to test than one
test is uncertain; one test alone has none. The trend is a straight line through the logarithm of
all ratios of an axis, so it is relative, and does not depend on the level that the robot file has.
"""

from collections.abc import Sequence
from datetime import date, datetime
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa
from scipy.stats import t as student

CONFIDENCE: Final = 0.95
TESTS_MIN: Final = 3
"""A straight line has a residual from three points on."""
TABLES: Final = ("tests", "weeks", "trends")


class Advice(StrEnum):
    """What the trend of an axis asks for."""

    NONE = "none"
    CALIBRATE = "calibrate"
    TOO_FEW = "too few self-tests"


class Week(NamedTuple):
    """Friction of one axis of a trainer in one week, as ratio to the robot file."""

    trainer: str
    leg: str
    axis: str
    week: date
    """Its Monday."""
    test_count: int
    median_ratio: float
    lowest_ratio: float
    highest_ratio: float
    mean_ratio: float
    half_width_ratio: float | None
    """Half the interval of the mean, 95 %; None of one test."""
    friction_si: float
    """Median: N·m, N."""


class Trend(NamedTuple):
    """Change of friction of one axis over all its self-tests; relative, so 0.05 is 5 %."""

    trainer: str
    leg: str
    axis: str
    test_count: int
    span_weeks: float
    """From the first self-test to the last."""
    growth_ratio_per_week: float | None
    """None of too few tests."""
    low_ratio_per_week: float | None
    high_ratio_per_week: float | None
    """Interval, 95 %."""
    change_ratio: float | None
    """From the first self-test to the last, by the line."""
    advice: Advice


class Unused(NamedTuple):
    """An axis in a self-test that is in no week."""

    trainer: str
    leg: str
    axis: str
    begun_utc: datetime
    fault: str


class Merged(NamedTuple):
    """Tables of all self-tests."""

    weeks: list[Week]
    trends: list[Trend]
    unused: list[Unused]


# A recording that was given twice, as a copy or by another folder, counts once.
_TESTS: Final = """
CREATE TABLE tests AS SELECT DISTINCT ON (recording, leg, axis, begun_utc) *
FROM read_parquet($files) ORDER BY trainer, leg, axis, begun_utc
"""
_WEEKS: Final = """
CREATE TABLE weeks AS
WITH grouped AS (
    SELECT trainer, leg, axis, date_trunc('week', begun_utc)::DATE AS week, count(*) AS test_count,
        median(friction_ratio) AS median_ratio, min(friction_ratio) AS lowest_ratio,
        max(friction_ratio) AS highest_ratio,
        avg(friction_ratio) AS mean_ratio, stddev_samp(friction_ratio) AS spread_ratio,
        median(friction_si) AS friction_si
    FROM tests WHERE fault = '' GROUP BY trainer, leg, axis, week
)
SELECT trainer, leg, axis, week, test_count, median_ratio, lowest_ratio, highest_ratio, mean_ratio,
    quantile * spread_ratio / sqrt(test_count) AS half_width_ratio, friction_si
FROM grouped LEFT JOIN quantiles ON degrees = test_count - 1 ORDER BY trainer, leg, axis, week
"""
_TRENDS: Final = """
CREATE TABLE trends AS
WITH timed AS (
    SELECT *, ln(friction_ratio) AS level,
        epoch(begun_utc - min(begun_utc) OVER (PARTITION BY trainer, leg, axis)) / 604800 AS at_week
    FROM tests WHERE fault = ''
), line AS (
    SELECT trainer, leg, axis, count(*) AS test_count, max(at_week) AS span_weeks,
        regr_slope(level, at_week) AS slope,
        sqrt(greatest(regr_syy(level, at_week) - slope * regr_sxy(level, at_week), 0)
            / (test_count - 2) / regr_sxx(level, at_week)) AS std_error
    FROM timed GROUP BY trainer, leg, axis
), bounded AS (
    SELECT line.*, test_count >= $tests_min AND span_weeks > 0 AS enough,
        CASE WHEN enough THEN exp(slope) - 1 END AS growth_ratio_per_week,
        CASE WHEN enough THEN exp(slope - quantile * std_error) - 1 END AS low_ratio_per_week,
        CASE WHEN enough THEN exp(slope + quantile * std_error) - 1 END AS high_ratio_per_week,
        CASE WHEN enough THEN exp(slope * span_weeks) - 1 END AS change_ratio
    FROM line LEFT JOIN quantiles ON degrees = test_count - 2
)
SELECT trainer, leg, axis, test_count, span_weeks, growth_ratio_per_week, low_ratio_per_week,
    high_ratio_per_week, change_ratio,
    CASE WHEN NOT enough THEN $too_few
        WHEN low_ratio_per_week * high_ratio_per_week > 0 AND abs(change_ratio) > $change_max
            THEN $calibrate
        ELSE $none END AS advice
FROM bounded ORDER BY trainer, leg, axis
"""
_UNUSED: Final = """
SELECT trainer, leg, axis, begun_utc, fault FROM tests WHERE fault <> '' ORDER BY ALL
"""


def merge(files: Sequence[Path], output: Path, change_max_ratio: float) -> Merged:
    """Merge the results of recordings, and write `friction_*.parquet` and `.csv`.

    Args:
        files: results of `Work.FRICTION`, at least one.
        output: folder of the tables.
        change_max_ratio: a trend that is certain and has changed friction by more asks to act.

    Raises:
        OSError: a table cannot be written.
    """
    import duckdb  # noqa: PLC0415 - who reads the tables alone does not need it

    with duckdb.connect() as database:
        database.execute(_TESTS, {"files": [str(file) for file in files]})
        (count,) = database.execute("SELECT count(*) FROM tests").fetchall()[0]
        degrees = list(range(1, count + 1))
        quantiles = student.ppf(0.5 + CONFIDENCE / 2, degrees)
        database.register("quantiles", pa.table({"degrees": degrees, "quantile": quantiles}))
        database.execute(_WEEKS)
        database.execute(
            _TRENDS,
            {
                "tests_min": TESTS_MIN,
                "change_max": change_max_ratio,
                **{advice.name.lower(): advice.value for advice in Advice},
            },
        )
        for name in TABLES:
            table = database.table(name)
            table.write_parquet(str(output / f"friction_{name}.parquet"))
            table.write_csv(str(output / f"friction_{name}.csv"))
        trends = database.table("trends").fetchall()
        return Merged(
            [Week._make(row) for row in database.table("weeks").fetchall()],
            [Trend._make((*row[:-1], Advice(row[-1]))) for row in trends],
            [Unused._make(row) for row in database.execute(_UNUSED).fetchall()],
        )
