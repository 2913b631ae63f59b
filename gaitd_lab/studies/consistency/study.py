"""The report of `gaitd consistency`: NEES and NIS, coverage, rest, gaps, drift, encoder offsets."""

from collections.abc import Callable, Iterable
from typing import Any, Final, TypeVar

from gaitd_lab.studies.consistency.figure import draw
from gaitd_lab.studies.consistency.measures import (
    Band,
    Consistency,
    Drifted,
    Gap,
    Offset,
    Plant,
    Rest,
    drifting,
    gaps,
    monte_carlo,
    offsets,
    still,
)
from gaitd_lab.studies.report import Cell, Measured, Report, Table, measured
from observer.filter.states import STATE_NAMES

T = TypeVar("T")

STEPS: Final = 400
LEVEL_RATIOS: Final = (0.8, 0.9, 0.95, 0.98, 1.0, 1.02, 1.05, 1.1, 1.2)
EFFORT: Final = ("N·m", "N")
GAUSSIAN: Final = ("68.3 %", "95.4 %", "99.7 %")


def study(plant: Plant, runs: int, seeds: int, stage: Callable[..., Any]) -> Report:
    """Measure the consistency of a plant's own observer.

    Args:
        plant: of a robot file.
        runs: of the Monte Carlo.
        seeds: draws of the encoders' noise at rest, in gaps and with wrong friction.
        stage: begins a stage of the work by its title; returns what is called with its progress.
    """
    found = monte_carlo(plant, runs, STEPS, stage("Monte Carlo"))
    rests: list[Rest] = []
    lost: list[list[Gap]] = []
    drifted: list[list[Drifted]] = []
    update = stage("rest, gaps and drift", float(seeds))
    for seed in range(1, seeds + 1):
        rests.append(still(plant, seed=seed))
        lost.append(gaps(plant, seed=seed))
        drifted.append(drifting(plant, LEVEL_RATIOS, seed))
        update(seed)
    tables = (
        _chi_squares(found, runs),
        _sigmas(found),
        _rest(plant, rests),
        _gaps(lost),
        _drift(drifted),
        _offsets(offsets(plant)),
    )
    within = all(max(gap.sigmas) <= 3.0 for draw in lost for gap in draw)
    passed = found.nees.inside and found.nis.inside and within
    figures = {"runs": draw(found, rests[0])}
    return Report("consistency", "Consistency of the observer", tables, figures, passed)


def _chi_squares(found: Consistency, runs: int) -> Table:
    title = (
        f"NEES and NIS of {runs} runs of {STEPS} cycles in motion; {found.discarded_count} more "
        "left the workspace"
    )
    head = ("", "mean", "95 % band of one instant", "instants inside", "ideal")
    rows = [
        ("NEES, 8 states", *_in_band(found.nees), "8, 95 %"),
        ("NIS, 2 samples", *_in_band(found.nis), "2, 95 %"),
        ("correlation of an innovation with the next", found.correlation, "", "", "0"),
    ]
    return Table(title, head, rows)


def _in_band(band: Band) -> tuple[Cell, ...]:
    outside = "" if band.inside else ", OUTSIDE"
    edges = f"{band.low:.2f} … {band.high:.2f}"
    return f"{band.mean:.2f}{outside}", edges, f"{band.inside_ratio:.0%}"


def _sigmas(found: Consistency) -> Table:
    shares = zip(STATE_NAMES, *found.within_ratio.tolist(), strict=True)
    rows = [(name, *(f"{share:.1%}" for share in three)) for name, *three in shares]
    head = ("state", "1 sigma", "2 sigma", "3 sigma")
    return Table("Share of the errors within", head, [*rows, ("Gaussian", *GAUSSIAN)])


def _rest(plant: Plant, rests: list[Rest]) -> Table:
    holds = (f"{law.stribeck:g} {unit}" for law, unit in zip(plant.frictions, EFFORT, strict=True))
    rows = [
        ("false effort of a patient, rms", *_axes(rests, lambda one: one.patient_rms)),
        ("sigma of the patient", *_axes(rests, lambda one: one.estimates.std[-1, 6:8])),
        ("sigma of the net effort", *_axes(rests, lambda one: one.estimates.net_std[-1])),
        ("friction holds up to", *holds),
    ]
    return Table("A minute at rest, no patient in the machine", ("", "hip", "slide"), rows)


def _gaps(draws: list[list[Gap]]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for same in zip(*draws, strict=True):
        gap = f"{1e3 * same[0].duration_s:.0f} ms"
        ends = _axes(same, lambda one: [1e3 * error for error in one.error], ("mrad", "mm"))
        rows += [
            (gap, "error at its end", *ends),
            (gap, "error over sigma, anywhere", *_axes(same, lambda one: one.sigmas, ("", ""))),
            (gap, "growth of sigma, at least", *_axes(same, lambda one: one.growth, ("", ""))),
        ]
    title = "Gaps without samples, in motion: the worst of 22"
    return Table(title, ("gap", "", "hip", "slide"), rows)


def _drift(draws: list[list[Drifted]]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for same in zip(*draws, strict=True):
        found = _axes(same, lambda one: one.friction_error)
        correlation = _axes(same, lambda one: one.correlation, ("", ""))
        true = _axes(same, lambda one: one.true_error)
        level = f"{same[0].level_ratio - 1.0:+.0%}"
        axes = zip(true, found, correlation, strict=True)
        rows.append((level, *(cell for axis in axes for cell in axis)))
    head = [f"{axis}: {what}" for axis in ("hip", "slide") for what in _DRIFT]
    return Table("Friction beside its level in the file", ("level", *head), rows)


_DRIFT: Final = ("true error", "found", "correlation")


def _offsets(found: list[Offset]) -> Table:
    head = ("offset of the hip's encoder", "believed after", "flagged", "valid again after")
    rows = [
        (
            f"{one.offset_rad:g} rad",
            f"{one.believed_after_cycles} cycles",
            "yes" if one.flagged else "NO",
            f"{one.valid_after_cycles} cycles",
        )
        for one in found
    ]
    return Table("An encoder offset that stays", head, rows)


def _axes(
    draws: Iterable[T], of: Callable[[T], Any], units: tuple[str, str] = EFFORT
) -> tuple[Measured | None, Measured | None]:
    """Measure a pair, hip and slide, over the draws."""
    hip, slide = zip(*(of(one) for one in draws), strict=True)
    return measured(hip, units[0]), measured(slide, units[1])
