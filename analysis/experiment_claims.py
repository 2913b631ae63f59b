"""The claims of the paper's section 4, each beside what the experiment shows over all seeds.

Each claim has criteria of the same form as targets. The paper prints no accuracy, so the criteria
are ours; they ask for the claim alone, and are wider than the targets where it says less.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from analysis import markdown
from analysis.experiment import Row
from analysis.experiment_targets import Figure, Plant, Scale, Scales, Target, figure


class Claim(NamedTuple):
    """A claim of the paper."""

    claim: str
    """In our words."""
    where: str
    """Equation and figure of the paper."""
    criteria: tuple[Target, ...]
    """What each seed must show."""
    remark: str = ""


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
        "asked for: within one quantum of the encoder",
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
        "our own target, three times, is missed",
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
        "most of the distance is the plant's own low-pass, with T1 = 20 ms: the error against the "
        "true friction is a tenth of it or less",
    ),
    Claim(
        "At rest friction is somewhere within its breakaway level, and keeps its value",
        "(11), (12); Fig. 4d",
        (_at_most("friction at rest, largest over breakaway", 100.0, 100.0),),
        "the observer limits it there; what it is cannot be known at rest",
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
        "where it is published; with the time at rest it is several times larger",
    ),
    Claim(
        "The slide rests longer than the hip, because it has more friction",
        "Fig. 5b",
        (_at_least("time at rest, slide more than hip", None, 0.0),),
        "depends on the amplitudes, which the paper does not print: ours move the slide more",
    ),
    Claim(
        "A step at rest goes to friction, whose process noise is larger there",
        "(15), (17); Fig. 5d, 10 s",
        (_at_least("step at rest: most that friction takes of it", None, 50.0),),
        "here the slide still creeps, which the observer takes for motion; with ideal sticking "
        "friction takes all of it",
    ),
    Claim(
        "When the slide moves, friction returns to its value and the disturbance is found",
        "(12); Fig. 5d, 5e",
        (_at_most("step at rest: 90 % after motion", None, 100.0),),
        "negative: found before the gate has opened; the paper's friction creeps under load",
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
        "every axis must turn round; at 0.25 Hz the hip takes its time",
    ),
)


def claims_table(draws: Sequence[Sequence[Row]], scales: Scales) -> str:
    """Return the table of all claims in Markdown.

    Args:
        draws: the rows of each seed, on a plant with the observer's friction law.
        scales: sizes that relative criteria refer to.

    Raises:
        KeyError: a claim names a row that the draws do not have.
    """
    rows = [{row.name: row for row in draw} for draw in draws]
    return markdown.table(
        ("claim", "paper", "what we see: median (range)", "asked for", "verdict"),
        [_cells(claim, rows, scales) for claim in CLAIMS],
    )


def _cells(
    claim: Claim, draws: Sequence[Mapping[str, Row]], scales: Scales
) -> tuple[str, str, str, str, str]:
    found = [
        figure([draw[criterion.row] for draw in draws], criterion, scales)
        for criterion in claim.criteria
    ]
    seen = "; ".join(map(_seen, found))
    asked = "; ".join(one.judged.words for one in found if one.judged)
    remark = f". *{claim.remark[0].upper()}{claim.remark[1:]}*" if claim.remark else ""
    return claim.claim, claim.where, f"{seen}{remark}", asked, _verdict(found)


def _seen(found: Figure) -> str:
    return f"{found.name}: {', '.join(filter(None, found.texts()))}"


def _verdict(found: Sequence[Figure]) -> str:
    judged = [one.judged for one in found if one.judged]
    if all(one.met for one in judged):
        return "seen"
    least = min(judged, key=lambda one: one.met_count)
    return f"seen in {least.met_count} of {least.seed_count}" if least.met_count else "not seen"
