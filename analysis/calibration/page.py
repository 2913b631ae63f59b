"""Page of a calibration: tables in Markdown and two pictures beside it."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from analysis import markdown
from analysis.calibration.advice import advice
from analysis.calibration.figures import draw_friction, draw_residuals
from analysis.calibration.fit import Result
from analysis.calibration.session import Calibration
from analysis.calibration.verdict import Score

Table = tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]
"""Title, column heads, rows of text."""

NAME: Final = "calibration"


def write_page(calibration: Calibration, robot_name: str, folder: Path) -> Path:
    """Write calibration.md, calibration_friction.png and calibration_residuals.png.

    Args:
        calibration: the result.
        robot_name: of the initial file.
        folder: created if missing.

    Raises:
        OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    draw_friction(calibration).savefig(folder / f"{NAME}_friction.png")
    draw_residuals(calibration).savefig(folder / f"{NAME}_residuals.png")
    path = folder / f"{NAME}.md"
    path.write_text(markdown.page(*_parts(calibration, robot_name)), encoding="utf-8")
    return path


def tables(calibration: Calibration) -> tuple[Table, Table]:
    """The quantities, and the scores on held-out data, before and after."""
    head = ("quantity", "unit", "before", "calibrated", "95 %")
    rows = tuple(_row(one) for one in calibration.results if one.exists)
    other = "eq. (11) fitted" if calibration.bristled else "bristles fitted"
    shown = {"before": calibration.before, other: calibration.other_law}
    shown = {title: score for title, score in shown.items() if score} | {"after": calibration.after}
    scores = ("", *shown), tuple(_scores(shown.values()))
    return ("Quantities", head, rows), (f"Held out: {calibration.held_out}", *scores)


def _parts(calibration: Calibration, robot_name: str) -> Iterator[str]:
    names = ", ".join(f"`{Path(source).name}`" for source in calibration.motion.sources)
    yield "# Calibration of the empty machine"
    yield f"From {names}, {calibration.motion.duration_s:.0f} s, beginning with `{robot_name}`."
    yield f"Mechanism by the file: {calibration.given_check}."
    yield f"Mechanism as fitted: {calibration.check}."
    if calibration.why_eq_11:
        yield f"Bristles are not used: {calibration.why_eq_11}."
    for name in calibration.behind_gap:
        yield f"At the {name} no bristles are tried: it has backlash."
    values, scores = tables(calibration)
    yield markdown.table(values[1], values[2])
    todo = [*advice(calibration.motion, calibration.fit.results), *calibration.too_slow]
    if todo:
        yield "What cannot be identified or judged from this recording, and what to record instead:"
        yield "\n".join(f"- {line}" for line in todo)
    held = (
        "every fourth two seconds of it"
        if "fourth" in calibration.held_out
        else "another recording"
    )
    yield f"On {held}, which took no part in the fit:"
    yield markdown.table(scores[1], scores[2])
    if calibration.refused:
        yield f"**Not to be used:** {calibration.refused}."
    elif calibration.needless:
        yield f"**Not needed:** {calibration.needless}."
    yield f"![friction over velocity]({NAME}_friction.png)"
    yield f"![what is left over position and velocity]({NAME}_residuals.png)"


def _row(one: Result) -> tuple[str, ...]:
    head = (one.quantity.label, one.quantity.unit, f"{one.before:.5g}")
    if one.calibrated:
        return (*head, f"{one.value:.5g}", f"± {one.half_interval:.2g}")
    kept = "kept" if one.value == one.before else f"{one.value:.5g}"
    return (*head, kept, f"not identified: {one.reason}")


def _scores(scores: Collection[Score]) -> Iterator[tuple[str, ...]]:
    for title, field, digits in (
        ("minus log likelihood per sample", "loss_per_sample", 3),
        ("mean NIS of the observer (2 is ideal)", "nis", 2),
        ("false hip torque, N·m rms while moving", "hip_rms_nm", 3),
        ("false slide force, N rms while moving", "slide_rms_n", 2),
    ):
        values = (getattr(score, field) for score in scores)
        yield title, *(f"{value:.{digits}f}" for value in values)
