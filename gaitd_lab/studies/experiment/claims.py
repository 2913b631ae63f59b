"""The claims of the paper's section 4, each beside what the experiment shows over all seeds.

Each claim has criteria of the same form as targets. The paper prints no accuracy, so the criteria
are ours; they ask for the claim alone, and are wider than the targets where it says less.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from gaitd_lab.studies.experiment.measures import Row
from gaitd_lab.studies.experiment.targets import Plant, Scale, Scales, Target, judge
from gaitd_lab.studies.report import Cell, Table, measured


class Claim(NamedTuple):
    """A claim of the paper."""

    claim: str
    """In our words."""
    where: str
    """Equation and figure of the paper."""
    criteria: tuple[Target, ...]
    """What each seed must show."""


def _at_most(
    row: str, hip: float | None, slide: float | None, scale: Scale = Scale.ONE, kind: str = "≤"
) -> Target:
    return Target(row, kind, (hip, slide), "the claim", (Plant.MATCHED,), scale)


def _at_least(row: str, hip: float | None, slide: float | None) -> Target:
    return _at_most(row, hip, slide, kind="≥")


CLAIMS: Final = (
    Claim(
        "An observer with this friction model is stable at a period of 10 ms",
        "(11), (23); Figs. 4a, 5a",
        (_at_most("position, rms error", 61.0, 49.0),),
    ),
    Claim(
        "After the torque's step at 2 s the estimate follows even a short peak of velocity",
        "Fig. 4b, magnified",
        (
            _at_most("velocity peak, difference", 5.0, None, kind="±"),
            _at_most("velocity peak, lag", 1.0, None, kind="±"),
        ),
    ),
    Claim(
        "The estimated velocity has less noise than the numerical derivative",
        "Figs. 4b, 5b",
        (_at_least("velocity, times better than differences", 1.0, 1.0),),
    ),
    Claim(
        "Without a disturbance all states of the axis are estimated accurately",
        "(18); Fig. 4, 2 to 15 s",
        (
            _at_most("undisturbed: velocity, rms error", 4.0, 2.0),
            _at_most("undisturbed: friction, rms error in motion", 0.05, 0.05, Scale.COULOMB),
            _at_most("undisturbed: disturbance, rms where shown", 0.05, 0.05, Scale.DISTURBANCE),
        ),
    ),
    Claim(
        "In motion the estimated friction is near the static law",
        "(13); Figs. 4d, 5d",
        (_at_most("friction, rms from the static law in motion", 0.2, 0.2, Scale.COULOMB),),
    ),
    Claim(
        "At rest friction is somewhere within its breakaway level, and keeps its value",
        "(11), (12); Fig. 4d",
        (_at_most("friction at rest, largest over breakaway", 100.0, 100.0),),
    ),
    Claim(
        "The change from memory to low-pass follows the true one",
        "(12); Fig. 4d, magnified",
        (_at_most("friction found after motion begins, median", 100.0, 100.0),),
    ),
    Claim(
        "A disturbance of the axis changes hardly any estimate but its own",
        "(16), (17); Fig. 4, from 15 s",
        (_at_most("friction, rms change by the own disturbance", 0.05, 0.05, Scale.COULOMB),),
    ),
    Claim(
        "The estimated disturbance follows the artificial one well",
        "(16), (21); Fig. 4e",
        (_at_most("disturbance, rms error where shown", 0.05, 0.05, Scale.DISTURBANCE),),
    ),
    Claim(
        "The slide rests longer than the hip, because it has more friction",
        "Fig. 5b",
        (_at_least("time at rest, slide more than hip", None, 0.0),),
    ),
    Claim(
        "A step at rest goes to friction, whose process noise is larger there",
        "(15), (17); Fig. 5d, 10 s",
        (_at_least("step at rest: most that friction takes of it", None, 50.0),),
    ),
    Claim(
        "When the slide moves, friction returns to its value and the disturbance is found",
        "(12); Fig. 5d, 5e",
        (_at_most("step at rest: 90 % after motion", None, 100.0),),
    ),
    Claim(
        "When the disturbance ends in motion, friction does not change",
        "Fig. 5d, 18 s",
        (
            _at_most("step gone in motion: friction, largest error", None, 0.1, Scale.COULOMB),
            _at_most("step gone in motion: 90 % after", None, 100.0),
        ),
    ),
    Claim(
        "The slide is estimated as well as the hip: accurate, little noise, fast",
        "Fig. 5",
        (
            _at_most("velocity, rms error", None, 4.0),
            _at_most("disturbance, rms error where shown", None, 0.05, Scale.DISTURBANCE),
        ),
    ),
    Claim(
        "There is no cross talk between the disturbances of hip and slide",
        "(21); Figs. 4e, 5e",
        (_at_most("cross talk from the other axis", 0.25, 2.0),),
    ),
    Claim(
        "In gait neither axis rests, so that nothing is lost to friction there",
        "section 4, outlook on closed loop",
        (
            _at_most("gait at 0.25 Hz: time at rest", 5.0, 5.0),
            _at_most("gait at 0.5 Hz: time at rest", 5.0, 5.0),
        ),
    ),
)


def claims_table(draws: Sequence[Sequence[Row]], scales: Scales, words: str = "") -> Table:
    """Return all criteria of all claims, and in how many seeds each is seen.

    Args:
        draws: the rows of each seed, on a plant with the observer's friction law.
        scales: sizes that relative criteria refer to.
        words: added to the title.

    Raises:
        KeyError: a claim names a row that the draws do not have.
    """
    by_name = [{row.name: row for row in draw} for draw in draws]
    rows: list[tuple[Cell, ...]] = []
    for claim in CLAIMS:
        for criterion in claim.criteria:
            same = [draw[criterion.row] for draw in by_name]
            judged = judge(criterion, same, scales)
            asked = judged.words if judged else ""
            seen = f"{judged.met_count} of {judged.seed_count}" if judged else ""
            rows.append((claim.claim, claim.where, *spread_of(same), asked, seen))
    head = ("claim", "in the paper", "measured", "hip", "slide", "asked for", "seen in")
    title = f"The paper's claims, on a plant with the paper's friction law{words}"
    return Table(title, head, rows)


def spread_of(same: Sequence[Row]) -> tuple[str, Cell, Cell]:
    """Return the name of a row, and its quantity over the seeds; empty where it has no unit."""
    first = same[0]
    hip = measured((row.hip for row in same), first.hip_unit)
    slide = measured((row.slide for row in same), first.slide_unit)
    return (
        first.name,
        hip or ("" if not first.hip_unit else None),
        slide or ("" if not first.slide_unit else None),
    )
