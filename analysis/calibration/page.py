"""Page of a calibration: tables in Markdown and two pictures beside it."""

from pathlib import Path
from typing import Final

from analysis.calibration.advice import advice
from analysis.calibration.figures import draw_friction, draw_residuals
from analysis.calibration.fit import Result
from analysis.calibration.session import Calibration

NAME: Final = "calibration"


def write_page(made: Calibration, robot_name: str, folder: Path) -> Path:
    """Write calibration.md, calibration_friction.png and calibration_residuals.png.

    Args:
        made: the result.
        robot_name: of the initial file.
        folder: created if missing.

    Raises:
        OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    draw_friction(made, folder / f"{NAME}_friction.png")
    draw_residuals(made, folder / f"{NAME}_residuals.png")
    path = folder / f"{NAME}.md"
    path.write_text("\n".join(_lines(made, robot_name)) + "\n", encoding="utf-8")
    return path


def _lines(made: Calibration, robot_name: str) -> list[str]:
    names = ", ".join(f"`{Path(source).name}`" for source in made.motion.sources)
    lines = [
        "# Calibration of the empty machine",
        "",
        f"From {names}, {made.motion.duration_s:.0f} s, beginning with `{robot_name}`.",
        "",
        f"Mechanism: {made.check}.",
        "",
        "| quantity | unit | before | calibrated | 95 % |",
        "|---|---|---|---|---|",
        *(_row(one) for one in made.fit.results if one.shown),
        "",
    ]
    todo = advice(made.motion, made.fit.results)
    if todo:
        lines += ["What cannot be identified from this recording, and what to record instead:", ""]
        lines += [f"- {line}" for line in todo]
        lines.append("")
    lines += _scores(made)
    if made.fault:
        lines += [f"**Not to be used:** {made.fault}.", ""]
    return [
        *lines,
        f"![friction over velocity]({NAME}_friction.png)",
        "",
        f"![what is left over position and velocity]({NAME}_residuals.png)",
    ]


def _row(one: Result) -> str:
    head = f"| {one.quantity.label} | {one.quantity.unit} | {one.before:.5g} |"
    if one.calibrated:
        return f"{head} {one.value:.5g} | ± {one.half_interval:.2g} |"
    kept = "kept" if one.value == one.before else f"{one.value:.5g}"
    return f"{head} {kept} | not identified: {one.reason} |"


def _scores(made: Calibration) -> list[str]:
    before, after = made.before, made.after
    held = "every fourth two seconds of it" if "fourth" in made.held_out else "another recording"
    return [
        f"On {held}, which took no part in the fit:",
        "",
        "| | before | after |",
        "|---|---|---|",
        f"| minus log likelihood per sample | {before.loss_per_sample:.3f} |"
        f" {after.loss_per_sample:.3f} |",
        f"| mean NIS of the observer (2 is ideal) | {before.nis:.2f} | {after.nis:.2f} |",
        f"| false hip torque, N·m rms while moving | {before.hip_rms_nm:.3f} |"
        f" {after.hip_rms_nm:.3f} |",
        f"| false slide force, N rms while moving | {before.slide_rms_n:.2f} |"
        f" {after.slide_rms_n:.2f} |",
        "",
    ]
