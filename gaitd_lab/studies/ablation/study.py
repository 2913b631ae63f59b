"""The report of `gaitd ablation`: a table and a figure for each question."""

from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

from gaitd_lab.studies.ablation.choices import SHIPPED
from gaitd_lab.studies.ablation.errors import Errors, Results, ablate, rest_counts
from gaitd_lab.studies.ablation.figures import draw
from gaitd_lab.studies.ablation.questions import QUESTIONS, Question
from gaitd_lab.studies.ablation.trials import planned, record
from gaitd_lab.studies.report import UNKNOWN, Cell, Report, Table, measured, rounded
from gaitd_lab.trial import Trial
from gaitd_lab.trials import Progress

PAIRS: Final = (
    ("friction, N·m / N", "friction", 1.0),
    ("net, N·m / N", "net", 1.0),
    ("velocity, mrad/s / mm/s", "velocity", 1e3),
    ("3σ patient, axis OK", "patient_covered", 1.0),
    ("3σ patient, at rest", "patient_at_rest_covered", 1.0),
    ("3σ net", "net_covered", 1.0),
    ("3σ velocity", "velocity_covered", 1.0),
    ("OK share", "ok_share", 1.0),
)
"""Columns of hip / slide: title, field of `Errors`, factor."""


class Recorded(NamedTuple):
    """The trials of one situation, over the draws."""

    rest_counts: tuple[int, int]
    """Samples at rest in all of them, hip and slide."""
    ended: tuple[str, ...]
    """Why the service stopped early, of each draw in which it did."""


def study(config: Path, seeds: int, stage: Callable[[str], Progress], *, quick: bool) -> Report:
    """Record every situation with each seed, and replay it with every choice.

    Args:
        config: trainer file with a plant.
        seeds: draws of all noise.
        stage: begins a trial by its title; returns what is called with its progress.
        quick: three short trials on the matched plant instead of all.

    Raises:
        TrialError: the service refused a trial.
    """
    results: Results = {}
    trials: dict[str, Recorded] = {}
    for seed in range(1, seeds + 1):
        plan = planned(config, quick=quick, seed=seed)
        for trial in record(plan, lambda title, seed=seed: stage(f"{seed}: {title}"), seed):
            trials[trial.name] = _with(trials.get(trial.name), trial)
            for cell, errors in ablate(trial).items():
                results.setdefault(cell, []).append(errors)
    return report(results, trials, seeds)


def report(results: Results, trials: dict[str, Recorded], seeds: int) -> Report:
    """Make the report of all draws."""
    asked = [one for one in QUESTIONS if _answered(one, results)[0]]
    tables = (
        _shipped(results, trials, seeds),
        *(_answer(question, results) for question in asked),
    )
    figures = {one.key: draw(one, *_answered(one, results), results) for one in asked}
    return Report("ablation", "The observer's choices, each on and off", tables, figures)


def _with(before: Recorded | None, trial: Trial) -> Recorded:
    counts, ended = before or Recorded((0, 0), ())
    hip, slide = rest_counts(trial)
    more = (trial.ended,) if trial.ended else ()
    return Recorded((counts[0] + hip, counts[1] + slide), (*ended, *more))


def _answered(question: Question, results: Results) -> tuple[list[str], list[str]]:
    """Return the situations and choices of a question that have results."""
    situations = [one for one in question.situations if (one, SHIPPED) in results]
    known = {choice for _, choice in results}
    return situations, [one for one in question.choices if one in known]


def _shipped(results: Results, trials: dict[str, Recorded], seeds: int) -> Table:
    head = (
        *("situation", *_range_heads("moving"), *_range_heads("OK"), *_range_heads("at rest")),
        *(title for title, _, _ in PAIRS),
        *("NIS", "samples at rest", "ended early"),
    )
    rows = [
        (
            situation,
            *_ranges(results[situation, SHIPPED], "patient"),
            *_ranges(results[situation, SHIPPED], "patient_ok"),
            *_ranges(results[situation, SHIPPED], "patient_at_rest"),
            *_medians(results[situation, SHIPPED]),
            f"{one.rest_counts[0]} / {one.rest_counts[1]}",
            f"{len(one.ended)} of {seeds}: {one.ended[0]}" if one.ended else "",
        )
        for situation, one in trials.items()
    ]
    return Table("As shipped: rms error of the patient's effort, and the rest", head, rows)


def _answer(question: Question, results: Results) -> Table:
    situations, choices = _answered(question, results)
    rows = [
        (situation, choice, *_ranges(errors, question.measure), *_medians(errors))
        for situation in situations
        for choice in choices
        for errors in (results[situation, choice],)
    ]
    heads = _range_heads(f"error of the {question.measured}")
    head = ("situation", "choice", *heads, *(title for title, _, _ in PAIRS), "NIS")
    return Table(question.title, head, rows)


def _range_heads(words: str) -> tuple[str, str]:
    return f"{words}, hip", f"{words}, slide"


def _ranges(draws: Sequence[Errors], field: str) -> tuple[Cell, Cell]:
    hip, slide = zip(*(getattr(one, field) for one in draws), strict=True)
    return measured(hip, "N·m"), measured(slide, "N")


def _medians(draws: Sequence[Errors]) -> list[Cell]:
    cells: list[Cell] = []
    for _, field, factor in PAIRS:
        axes = zip(*(getattr(one, field) for one in draws), strict=True)
        found = [measured(factor * value for value in axis) for axis in axes]
        cells.append(" / ".join(rounded(one.value) if one else UNKNOWN for one in found))
    return [*cells, median(one.nis for one in draws)]
