"""Page of the ablation: figures, tables, and where 3 sigma do not cover and why."""

import math
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from analysis import markdown
from analysis.ablation import Ablation, Errors, Results, Summary
from analysis.ablation_choices import SHIPPED
from analysis.ablation_figures import (
    COVERAGES,
    answered,
    draw_coverage,
    draw_question,
    three_digits,
)
from analysis.ablation_questions import QUESTIONS, REASONS, WRONG, Question
from analysis.drawing import AXES
from analysis.spread import in_words, spread
from analysis.trial import Pair

PAGE: Final = "ablation.md"
COVERAGE_FIGURE: Final = "ablation_coverage.png"
TEXT_WIDTH: Final = 118
LOW: Final = 0.95
"""Lower coverage is listed with its reason."""
COLUMNS: Final = (
    ("moving", "patient"),
    ("OK", "patient_ok"),
    ("at rest", "patient_at_rest"),
    ("friction", "friction"),
    ("net", "net"),
)
UNKNOWN_REASON: Final = "not one of the situations that this page explains"


def write_page(folder: Path, found: Ablation, command: str) -> list[Path]:
    """Write the page and its figures; return their paths.

    Args:
        folder: must exist.
        found: of every seed.
        command: the command line of the run.

    Raises:
        OSError: a file cannot be written.
    """
    asked = [one for one in (*QUESTIONS, *WRONG) if answered(one, found.medians)[0]]
    situations = [one.situation for one in found.summaries]
    paths = [folder / PAGE, folder / COVERAGE_FIGURE]
    draw_coverage(situations, found.medians, paths[1])
    for question in asked:
        paths.append(folder / figure_name(question))
        draw_question(question, found, paths[-1])
    paths[0].write_text(markdown.page(*_parts(found, asked, command)), "utf-8")
    return paths


def tables(results: Results) -> Iterator[tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]]:
    """Return a table of text for each question: title, column heads, rows."""
    heads = ("", "moving", "at rest", "friction", "net", "3σ patient", "OK share", "NIS")
    for question in (*QUESTIONS, *WRONG):
        situations, choices = answered(question, results)
        rows: list[tuple[str, ...]] = []
        for situation in situations:
            rows.append((situation, *("",) * (len(heads) - 1)))
            for choice in choices:
                errors = results[situation, choice]
                shown = (errors.patient, errors.patient_at_rest, errors.friction, errors.net)
                shares = (pair(errors.patient_covered, 2), pair(errors.ok_share, 2))
                nis = three_digits(errors.nis)
                rows.append((f"  {choice}", *map(pair, shown), *shares, nis))
        if rows:
            yield question.title, heads, tuple(rows)


def figure_name(question: Question) -> str:
    """File name of a question's figure."""
    return f"ablation_{question.key}.png"


def pair(values: Pair, digits: int | None = None) -> str:
    """Hip and slide in one cell; with `digits` digits, or as many as are meaningful."""

    def text(value: float) -> str:
        return three_digits(value) if digits is None or math.isnan(value) else f"{value:.{digits}f}"

    return " / ".join(map(text, values))


def _parts(found: Ablation, asked: Sequence[Question], command: str) -> Iterator[str]:
    results, summaries = found.medians, found.summaries
    yield from _introduction(command, len(found.draws))
    yield from _overview(results, summaries)
    yield from _ranges(found)
    wrong = [question for question in asked if question in WRONG]
    for question in asked:
        if question not in wrong:
            yield from _section(question, results, "##")
    yield from _coverage(results, summaries)
    if wrong:
        yield "## What if the parameters are wrong"
    for question in wrong:
        yield from _section(question, results, "###")


def _introduction(command: str, seeds: int) -> Iterator[str]:
    yield "# The observer's choices, each on and off"
    yield _prose(
        f"Made by `{command}`: this page, its tables and its figures. The real loop runs on the "
        "virtual machine over CAN frames; each situation is recorded once for each of "
        f"{seeds} seeds of all noise, with what was true beside it, and replayed through "
        "observers of which one choice is changed. Each number is the median over the seeds; a "
        "line on a bar is their range. The same command gives the same numbers."
    )
    yield _prose(
        "All errors are root mean squares of estimate minus truth, **hip in N·m / slide in N**. "
        "*Moving*: the joint's true gate a(v) is above 0.5. *OK*: the observer itself calls the "
        "axis OK. *At rest*: the joint has truly not moved for more than 100 ms, where only net = "
        "patient - friction can be observed. Velocity is in mrad/s / mm/s. A dash: there is "
        "nothing to compare. Plants: `paper` is the observer's own friction law, "
        "`paper_sticking` the same with ideal sticking at rest, `lugre` bristles, another law. "
        "Sensors have noise, quanta and jitter in all of them."
    )


def _overview(results: Results, summaries: Sequence[Summary]) -> Iterator[str]:
    yield "## As shipped, in every situation"
    head = ("situation", "judged s", *(head for head, _ in COLUMNS), "velocity", "NIS", "OK share")
    rows: list[list[str]] = []
    for one in summaries:
        errors = results[one.situation, SHIPPED]
        cells = [*_error_cells(errors), three_digits(errors.nis), pair(errors.ok_share, 2)]
        rows.append([one.situation, f"{one.judged_s:.1f}", *cells])
    yield markdown.table(head, rows, text_columns=1)
    ended = [
        f"`{one.situation}` after {one.judged_s:.0f} s ({one.ended})"
        for one in summaries
        if one.ended
    ]
    if ended:
        yield _prose(
            f"The service stopped {', '.join(ended)}: an axis that sticks ideally gives no count "
            "for as long as an encoder that is frozen. The rows until then are used."
        )


def _ranges(found: Ablation) -> Iterator[str]:
    yield f"Median and range over the {len(found.draws)} seeds, as shipped:"
    measures = (("moving", "patient"), ("OK", "patient_ok"), ("net", "net"))
    columns = [
        (f"{head}, {one.name}", field, axis, one.effort)
        for head, field in measures
        for axis, one in enumerate(AXES)
    ]
    rows: list[list[str]] = []
    for one in found.summaries:
        errors = [draw[one.situation, SHIPPED] for draw in found.draws]
        cells = (
            in_words(spread(getattr(of, field)[axis] for of in errors), unit)
            for _, field, axis, unit in columns
        )
        rows.append([one.situation, *cells])
    yield markdown.table(("situation", *(head for head, *_ in columns)), rows, text_columns=1)


def _section(question: Question, results: Results, level: str) -> Iterator[str]:
    situations, choices = answered(question, results)
    yield f"{level} {question.title}"
    yield _prose(question.text)
    yield f"![{question.title}]({figure_name(question)})"
    heads = (*(head for head, _ in COLUMNS), "velocity")
    shares_of = (*(f"3σ {label}" for _, label, *_ in COVERAGES), "OK share", "NIS")
    rows: list[list[str]] = []
    for situation in situations:
        for choice in choices:
            errors = results[situation, choice]
            shares = (getattr(errors, field) for field, *_ in COVERAGES)
            cells = (pair(one, 2) for one in (*shares, errors.ok_share))
            nis = three_digits(errors.nis)
            rows.append([situation, choice, *_error_cells(errors), *cells, nis])
    yield markdown.table(("situation", "choice", *heads, *shares_of), rows, text_columns=2)


def _coverage(results: Results, summaries: Sequence[Summary]) -> Iterator[str]:
    yield "## Measured 3-sigma coverage"
    yield _prose(
        "The share of samples at which the truth lies within 3 sigma of the estimate, as shipped; "
        "0.997 if errors were Gaussian and sigma right. Errors last for some samples, so a share "
        "of half a minute is itself known to a percent or so; one at rest often stands on few "
        "samples of few stops, and the last column says on how many in all seeds: below a "
        "hundred take it, and the error at rest in the tables above, as a hint. Above 0.997 sigma "
        "is too large: process noise allows for a patient who changes all the time, and most do "
        "not."
    )
    yield f"![Coverage]({COVERAGE_FIGURE})"
    rows: list[list[str]] = []
    for one in summaries:
        errors = results[one.situation, SHIPPED]
        shares = (pair(getattr(errors, field), 3) for field, *_ in COVERAGES)
        rows.append([one.situation, *shares, pair(one.rest_count, 0)])
    head = ("situation", *(label for _, label, *_ in COVERAGES), "samples at rest")
    yield markdown.table(head, rows, text_columns=1)
    yield f"Where it is below {LOW:g}, and why:"
    yield "\n".join(_low(results, summaries)) or "- nowhere."


def _low(results: Results, summaries: Sequence[Summary]) -> Iterator[str]:
    for one in summaries:
        errors = results[one.situation, SHIPPED]
        found = [
            f"{label} {axis} {share:.3f}{_of_how_many(field, count)}"
            for field, label, *_ in COVERAGES
            for axis, share, count in zip(
                ("hip", "slide"), getattr(errors, field), one.rest_count, strict=True
            )
            if share < LOW
        ]
        if found:
            text = f"- {one.situation}: {'; '.join(found)}. {_reason(one.situation)}."
            yield textwrap.fill(text, TEXT_WIDTH, subsequent_indent="  ", break_on_hyphens=False)


def _of_how_many(field: str, count: int) -> str:
    return f" of {count} samples" if field == "patient_at_rest_covered" else ""


def _reason(situation: str) -> str:
    text = next((why for name, why in REASONS if situation.startswith(name)), UNKNOWN_REASON)
    return text[0].upper() + text[1:]


def _error_cells(errors: Errors) -> list[str]:
    milli = (1e3 * errors.velocity[0], 1e3 * errors.velocity[1])
    return [*(pair(getattr(errors, field)) for _, field in COLUMNS), pair(milli)]


def _prose(text: str) -> str:
    return textwrap.fill(text, TEXT_WIDTH, break_long_words=False, break_on_hyphens=False)
