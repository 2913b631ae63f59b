"""Results of `gaitd consistency` as tables: printed, and parts of docs/consistency.md."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, TypeVar

from analysis.consistency import Band, Consistency, Drifted, Gap, Offset, Plant, Rest
from analysis.spread import in_words, spread
from observer.filter.states import STATE_NAMES

T = TypeVar("T")


class Table(NamedTuple):
    """A part of the page, by its name."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class Draws(NamedTuple):
    """Measurements that were repeated with several seeds of the encoders' noise."""

    rests: list[Rest]
    gaps: list[list[Gap]]
    drifted: list[list[Drifted]]


PARTS: Final = ("chi_squares", "sigmas", "rest", "gaps", "drift")
"""Names of the tables in the page, in the order of `tables`."""
AXES: Final = (("hip", "N·m"), ("slide", "N"))


def tables(plant: Plant, found: Consistency, draws: Draws) -> tuple[Table, ...]:
    """Format all results but those of offsets, in the order of reading."""
    return _chi_squares(found), _sigmas(found), _rest(plant, draws), _gaps(draws), _drift(draws)


def headline(found: Consistency, run_count: int, seed_count: int) -> str:
    """Say what was run."""
    return (
        f"Monte Carlo  {run_count} runs of {len(found.nees_over_time)} steps, both axes in motion\n"
        f"             {found.discarded_count} more discarded: noise carried the leg to its edges\n"
        f"rest, gaps and drift: median (range) of {seed_count} seeds"
    )


def offset_lines(found: Sequence[Offset]) -> str:
    """Format the reaction to a lasting offset, which has no noise."""
    return "\n".join(
        f"offset       {one.offset_rad:.2f} rad of the hip's encoder believed after "
        f"{one.believed_after_cycles} cycles, {'flagged' if one.flagged else 'NOT FLAGGED'}, valid "
        f"again after {one.valid_after_cycles}"
        for one in found
    )


def _chi_squares(found: Consistency) -> Table:
    head = ("", "mean", "95 % band of one instant", "instants inside", "ideal")
    return Table(
        "consistency; of innovations the correlation",
        head,
        (
            ("NEES, 8 states", *_in_band(found.nees), "8, 95 %"),
            ("NIS, 2 samples", *_in_band(found.nis), "2, 95 %"),
            ("one innovation with the next", f"{found.correlation:+.3f}", "", "", "0"),
        ),
    )


def _in_band(band: Band) -> tuple[str, str, str]:
    word = "" if band.inside else ", OUTSIDE"
    return (
        f"{band.mean:.3g}{word}",
        f"{band.low:.2f} .. {band.high:.2f}",
        f"{band.inside_ratio:.0%}",
    )


def _sigmas(found: Consistency) -> Table:
    shares = zip(STATE_NAMES, *found.within_ratio.tolist(), strict=True)
    rows = tuple((name, *(f"{share:.1%}" for share in three)) for name, *three in shares)
    ideal = ("Gaussian", "68.3%", "95.4%", "99.7%")
    return Table("within", ("state", "1 sigma", "2 sigma", "3 sigma"), (*rows, ideal))


def _rest(plant: Plant, draws: Draws) -> Table:
    title = "at rest for 60 s, no patient in the machine"
    figures: tuple[tuple[str, Callable[[Rest, int], float]], ...] = (
        ("what is taken for a patient, rms", lambda one, axis: one.patient_rms[axis]),
        ("sigma of the split", lambda one, axis: one.estimates.std[-1, 6 + axis]),
        ("sigma of the net effort", lambda one, axis: one.estimates.net_std[-1, axis]),
    )
    rows = [
        (name, *(_cell(draws.rests, of, axis, unit) for axis, (_, unit) in enumerate(AXES)))
        for name, of in figures
    ]
    holds = tuple(
        f"{one.stribeck:g} {unit}" for one, (_, unit) in zip(plant.frictions, AXES, strict=True)
    )
    return Table(title, ("", "hip", "slide"), (*rows, ("friction holds up to", *holds)))


def _gaps(draws: Draws) -> Table:
    title = "gaps: largest error of 22 gaps, in motion"
    figures: tuple[tuple[str, Callable[[Gap, int], float], tuple[str, str]], ...] = (
        ("error at its end", lambda one, axis: 1e3 * one.error[axis], ("mrad", "mm")),
        ("error over sigma, anywhere", lambda one, axis: one.sigmas[axis], ("", "")),
        ("sigma grew at least", lambda one, axis: one.growth[axis], ("times", "times")),
    )
    rows: list[tuple[str, ...]] = []
    for same in zip(*draws.gaps, strict=True):
        duration = f"{1e3 * same[0].duration_s:.0f} ms"
        for name, of, units in figures:
            cells = (_cell(same, of, axis, units[axis]) for axis in range(2))
            rows.append((duration, name, *cells))
    return Table(title, ("gap", "", "hip", "slide"), tuple(rows))


def _drift(draws: Draws) -> Table:
    title = "drift of friction, as found by its monitor; empty machine in motion"
    rows: list[tuple[str, ...]] = []
    for same in zip(*draws.drifted, strict=True):
        level = f"{same[0].level_ratio - 1.0:+.0%}"
        cells: list[str] = []
        for axis, (_, unit) in enumerate(AXES):
            cells.append(f"{same[0].true_error[axis]:+.3g} {unit}")
            cells.append(_cell(same, lambda one, axis: one.friction_error[axis], axis, unit))
            cells.append(_cell(same, lambda one, axis: one.correlation[axis], axis, ""))
        rows.append((level, *cells))
    head = [f"{name}: {what}" for name, _ in AXES for what in ("true", "found", "correlation")]
    return Table(title, ("true levels", *head), tuple(rows))


def _cell(draws: Sequence[T], of: Callable[[T, int], float], axis: int, unit: str) -> str:
    return in_words(spread(of(one, axis) for one in draws), unit)
