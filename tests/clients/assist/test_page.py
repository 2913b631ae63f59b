"""The figure of docs/assist.md, from walks with several seeds; written with --write-assist."""

import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from assisted import Answers, Gym, shipped
from gaitd_names import Cause, Mode
from matplotlib.figure import Figure
from sessions import elsewhere

from analysis.drawing import ESTIMATE, style, x_label
from gaitd_lab.patients import Slacking, of_ability, resisting, spastic, tiring, weak

DOCS = Path(__file__).parents[3] / "docs"
PICTURE = "assist.png"
STRIDES = 8
PROCESSES = 4
SEEDS = range(1, 11)
PATIENTS = {
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
        walk = gym.walk(model(), STRIDES, Answers(shipped().controller()))
        record = walk.session.record
        assert (record.mode, record.verdict.cause) == (Mode.GAIT, Cause.NONE)
        lines = walk.answers.lines[:STRIDES]
        return np.array([[of(line) for line in lines] for of in COLUMNS.values()], float)

    return plan


def test_the_page_shows_its_figure():
    page = (DOCS / "assist.md").read_text(encoding="utf-8")

    assert re.findall(r"!\[[^\]]+\]\((\S+)\)", page) == [PICTURE]
    assert (DOCS / PICTURE).read_bytes().startswith(b"\x89PNG")
    assert all(f"{name}" in page for name in PATIENTS)


@pytest.mark.thorough
@pytest.mark.timeout(1800)
def test_each_patient_walks_with_each_seed_and_is_drawn(pytestconfig, tmp_path):
    gyms = [Gym(seed=seed) for seed in SEEDS]
    with ThreadPoolExecutor(PROCESSES) as pool:
        walks = [
            [pool.submit(elsewhere, gym, walked(model)) for gym in gyms]
            for model in PATIENTS.values()
        ]
    figure = Figure(figsize=(13, 13), layout="constrained")
    panels = figure.subplots(len(PATIENTS), len(COLUMNS), sharex=True, sharey="col")
    for row, name, walk in zip(panels, PATIENTS, walks, strict=True):
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
