"""The figure and the table of docs/assist.md, written with --write-assist.

The figure is of walks with several seeds, the table of one: each kind of patient under both laws.
"""

import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from assisted import CADENCE_HZ, Answers, Gym, leg_controller
from gaitd_names import Cause, Mode
from kinds_of_patients import PATIENTS, STEADY
from matplotlib.figure import Figure
from sessions import CONFIGS, elsewhere

from analysis import markdown
from analysis.drawing import ESTIMATE, style, x_label
from gaitd_lab.patients import Slacking, of_ability, resisting, spastic, tiring, weak

DOCS = Path(__file__).parents[3] / "docs"
PAGE = DOCS / "assist.md"
HEADER = (
    "patient",
    "strays at most, of these in the last three strides",
    "settled after strides: hip, slide",
    "assist, mean: hip, slide",
    "at its peak: hip, slide",
)
LAWS = ("estimate", "stray")
CAP = np.array([20.0, 150.0])
NEAR_CAP = 0.05
"""Assist has settled where its peak stays as near to that of the last three strides, in caps."""
TABLE_STRIDES = 9
PAIRS = [
    ("passive", "passive"),
    ("all", "passive"),
    ("weak at 0.55 to 0.75", "half"),
    ("passive", "resisting"),
]
"""Patients of the right and of the left leg."""
PICTURE = "assist.png"
STRIDES = 8
PROCESSES = 4
SEEDS = range(1, 11)
DRAWN = {
    "passive": lambda: of_ability(0.0),
    "half able": lambda: of_ability(0.5),
    "able": lambda: of_ability(1.0),
    "weak phase": lambda: weak(of_ability(1.0), 0.55, 0.75),
    "slacking": Slacking,
    "resisting": lambda: resisting,
    "spastic": lambda: spastic,
    "tiring": lambda: tiring(16.0),
}
COLUMNS = {
    "stiffness, share": lambda line: line.values["stiffness_ratio"],
    "assist of the hip, mean, N·m": lambda line: line.hip["assist_mean"],
    "error of the hip, rms, deg": lambda line: float(np.degrees(line.hip["error_rms"])),
    "patient's share of the work": lambda line: line.values["share_ratio"],
}


def walked(model):
    """Figures of each stride, shape (columns, strides), NaN where one is not known."""

    def plan(gym):
        walk = gym.walk(model(), STRIDES, Answers(leg_controller()))
        record = walk.session.record
        assert (record.mode, record.verdict.cause) == (Mode.GAIT, Cause.NONE)
        lines = walk.answers.lines[:STRIDES]
        return np.array([[of(line) for line in lines] for of in COLUMNS.values()], float)

    return plan


def test_the_page_shows_its_figure():
    page = PAGE.read_text(encoding="utf-8")

    assert re.findall(r"!\[[^\]]+\]\((\S+)\)", page) == [PICTURE]
    assert (DOCS / PICTURE).read_bytes().startswith(b"\x89PNG")
    assert all(f"{name}" in page for name in DRAWN)


@pytest.mark.thorough
@pytest.mark.timeout(1800)
def test_each_patient_walks_with_each_seed_and_is_drawn(pytestconfig, tmp_path):
    gyms = [Gym(seed=seed) for seed in SEEDS]
    with ThreadPoolExecutor(PROCESSES) as pool:
        walks = [
            [pool.submit(elsewhere, gym, walked(model)) for gym in gyms] for model in DRAWN.values()
        ]
    figure = Figure(figsize=(13, 13), layout="constrained")
    panels = figure.subplots(len(DRAWN), len(COLUMNS), sharex=True, sharey="col")
    for row, name, walk in zip(panels, DRAWN, walks, strict=True):
        made = np.array([one.result() for one in walk])
        low, high = made.min(axis=0), made.max(axis=0)
        number = np.arange(1, made.shape[2] + 1)
        for column, panel in enumerate(row):
            panel.fill_between(number, low[column], high[column], color=ESTIMATE, alpha=0.35)
            panel.plot(number, np.median(made[:, column], axis=0), color=ESTIMATE)
            style(panel)
        style(row[0], unit=name)
    for panel, title in zip(panels[0], COLUMNS, strict=True):
        style(panel, title)
    for panel in panels[-1]:
        x_label(panel, "stride")
    folder = DOCS if pytestconfig.option.write_assist else tmp_path
    figure.savefig(folder / PICTURE, dpi=80)

    assert (folder / PICTURE).stat().st_size > 10_000


class Figures(NamedTuple):
    """One walk under one law; rows and pairs are hip and slide."""

    strayed: np.ndarray
    """At most: over the walk, and in its last three strides; rad, m."""
    settled: np.ndarray
    """Strides until the peak of the assist has settled."""
    means: np.ndarray
    """Mean size of the assist in the last three strides, in caps."""
    peaks: np.ndarray
    """Its peak in each stride, in caps."""


def figures_of(walk):
    record = walk.session.record
    assert (record.mode, record.verdict.cause) == (Mode.GAIT, Cause.NONE)
    peaks = walk.peaks() / CAP
    moves = np.abs(peaks - peaks[-3:].mean(axis=0)) > NEAR_CAP
    last = [np.max(np.flatnonzero(one), initial=-1) + 1 for one in moves.T]
    strayed = [np.abs(walk.errors(begin)).max(axis=0) for begin in (0, TABLE_STRIDES - 3)]
    means = [np.abs(one).mean(axis=0) / CAP for one in walk.assist_of_strides()[-3:]]
    return Figures(np.array(strayed), np.array(last), np.mean(means, axis=0), peaks)


def judged(model, law):
    def plan(gym):
        answers = Answers(leg_controller(('law = "estimate"', f'law = "{law}"')))
        return figures_of(gym.walk(model(), TABLE_STRIDES, answers))

    return plan


def judged_with_two_legs(names):
    def plan(gym):
        walks = gym.walk_legs([PATIENTS[name]() for name in names], TABLE_STRIDES)
        return [figures_of(walk) for walk in walks]

    return plan


def row_of(words, figures):
    (hip, slide), (hip_late, slide_late) = figures.strayed
    strayed = f"{np.degrees(hip):.1f}°, {1e3 * slide:.0f} mm"
    late = f"{np.degrees(hip_late):.1f}°, {1e3 * slide_late:.0f} mm"
    mean, peak = 100.0 * figures.means, 100.0 * figures.peaks[-3:].max(axis=0)
    return (
        words,
        f"{strayed}; {late}",
        "{}, {}".format(*figures.settled),
        f"{mean[0]:.1f} %, {mean[1]:.1f} %",
        f"{peak[0]:.0f} %, {peak[1]:.0f} %",
    )


def write(place, rows):
    """Fill a place of the page with a table."""
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(markdown.filled(text, {place: markdown.table(HEADER, rows)}), encoding="utf-8")


@pytest.mark.thorough
@pytest.mark.timeout(3600)
def test_each_patient_under_both_laws_is_a_line_of_the_table(pytestconfig):
    gym = Gym(cadence_hz=CADENCE_HZ)
    made = {
        (name, law): elsewhere(gym, judged(model, law))
        for name, model in PATIENTS.items()
        for law in LAWS
    }
    rows = [row_of(f"{name}, law of the {law}", one) for (name, law), one in made.items()]
    if pytestconfig.option.write_assist:
        write("patients", rows)

    for name in STEADY:
        by_estimate, by_stray = (made[name, law] for law in LAWS)
        assert (by_estimate.settled <= 3).all(), name
        if name.startswith("resisting"):
            most = by_stray.peaks.max(axis=0)
            assert (by_estimate.peaks.max(axis=0) <= most).all(), name
    passive, before = (made["passive", law] for law in LAWS)
    assert (passive.strayed <= 1.05 * before.strayed).all()


@pytest.mark.thorough
@pytest.mark.timeout(3600)
def test_each_leg_of_a_pair_is_a_line_of_the_table(pytestconfig):
    """A patient is helped the same, whatever the other leg does."""
    gym = Gym(config=CONFIGS / "two_legs.toml")
    made = [(names, elsewhere(gym, judged_with_two_legs(names))) for names in PAIRS]
    if pytestconfig.option.write_assist:
        lines = [
            row_of(f"{leg}: {names[index]}; {gym.legs[1 - index]}: {names[1 - index]}", pair[index])
            for names, pair in made
            for index, leg in enumerate(gym.legs)
        ]
        write("pairs", lines)

    of_passive = [
        one
        for names, pair in made
        for name, one in zip(names, pair, strict=True)
        if name == "passive"
    ]
    for one in of_passive[1:]:
        assert np.abs(one.peaks[-3:] - of_passive[0].peaks[-3:]).max() <= NEAR_CAP
