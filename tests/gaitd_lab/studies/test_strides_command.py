"""The study of strides: one walk measured, and the table of several seeds."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import gaitd
from sessions import CONFIGS

from analysis.recording import RecordingError
from analysis.replay import setup_for
from gaitd_lab.studies import strides as study
from gaitd_lab.studies.report import Table, measured
from gaitd_lab.studies.strides import Case, measure
from gaitd_lab.trials import Situation, Trials
from observer.filter.states import PATIENT, VELOCITY
from observer.offline import smooth_batch
from observer.offline.batch import Columns
from observer.strides import strides_of


def test_a_walk_is_measured_from_its_second_stride_on(soon):
    walk = Trials(soon / "demo.toml").gait(Situation(cadence_hz=0.5, programme="active"), 11.0)

    figures = measure(walk, walk.robot)

    made = walk.recording
    columns = Columns(made.time_s, made.position, made.effort)
    strides = strides_of(smooth_batch.run_smoothed(setup_for(walk.robot), columns), columns)[1:]
    power = np.maximum(walk.truth[:, PATIENT] * walk.truth[:, VELOCITY], 0.0)
    true_j = np.mean(
        [0.01 * power[row : row + one.sample_count].sum(axis=0) for row, one in strides], axis=0
    )
    names = list(study.UNITS)
    assert figures[names[4]] == pytest.approx(tuple(true_j), rel=0.01)
    assert max(map(abs, figures[names[5]])) <= 3.0
    assert min(*figures[names[2]], *figures[names[3]]) >= 98.0
    assert figures[names[1]][0] < 0.5 * figures[names[0]][0]  # the smoother knows what came after
    assert figures[names[0]][1] < 5.0


def test_the_table_has_median_and_range_of_all_seeds(tmp_path, monkeypatch):
    figures = [{"filter, rms error": (one, 2.0 * one)} for one in (0.3, 0.1, 0.2)]
    monkeypatch.setattr(study, "cases", lambda *_: [Case(Situation(programme="active"), figures)])
    monkeypatch.setattr(study, "DRAWN_S", 3.0)
    monkeypatch.setattr("gaitd_lab.studies.report.DPI", 20)
    files = Table("Wrong files", ("file", "error"), [("leg heavier", measured([1.0, 3.0], "N"))])
    monkeypatch.setattr(study.wrong_file, "table", lambda *_: files)

    ran = gaitd("strides", "--output", tmp_path)

    assert ran.code == 0, ran.err
    assert (tmp_path / "strides_active.png").read_bytes().startswith(b"\x89PNG")
    assert re.search(r"active: filter, rms error +0.2 \(0.1 … 0.3\) N·m", ran.out)
    page = (tmp_path / "strides.md").read_text("utf-8")
    assert "| 0.2 (0.1 … 0.3) N·m | 0.4 (0.2 … 0.6) N |" in page
    assert "| leg heavier | 2 (1 … 3) N |" in page


@pytest.mark.thorough
def test_a_baseline_takes_off_what_a_wrong_file_adds_and_sigma_holds_what_is_stated(monkeypatch):
    wrong = study.wrong_file
    monkeypatch.setattr(wrong, "CADENCES_HZ", (0.4,))
    monkeypatch.setattr(wrong, "MINUTE_S", 36.0)
    monkeypatch.setattr(wrong, "WALK_S", 20.0)
    names = "leg 15 % heavier", "friction 15 % over position", "torque offset 1 N·m"
    monkeypatch.setattr(wrong, "FILES", {name: wrong.FILES[name] for name in names})
    soft = "an elastic hip drive, 800 N·m/rad"
    monkeypatch.setattr(wrong, "MACHINES", {soft: wrong.MACHINES[soft]})
    monkeypatch.setattr(wrong, "AGES_S", (300.0,))
    monkeypatch.setattr(wrong, "DRAWS", 30)

    rows = wrong.table(CONFIGS / "demo.toml", [1], lambda _: lambda _: None).rows

    errors_nm = {(name, how): hip.value for name, _, how, hip, *_ in rows if hip != ""}
    for name in names:
        true_nm = errors_nm[name, "the true file"]
        assert errors_nm[name, "with"] < max(errors_nm[name, "without"] / 2.0, true_nm)
        assert errors_nm[name, "with"] < 1.3 * true_nm
        [clean] = [row[3:] for row in rows if (row[0], row[2]) == (name, "with")]
        for error, sigma, beyond, friction_beyond, valid in (clean[:5], clean[5:]):
            assert sigma.value < 2.0 * error.value
            assert max(beyond.value, friction_beyond.value) < 1.0
            assert valid.value > 95.0
    falls = {how: cells for name, _, how, *cells in rows if name.startswith("friction falls")}
    for error, sigma, beyond, *_ in (falls["with"][:5], falls["with"][5:]):
        assert 0.4 * error.value < sigma.value < 2.5 * error.value
        assert beyond.value < 1.0
    assert falls["with"][0].value > 1.3 * falls["the true file"][0].value
    [cells] = [row[3:] for row in rows if row[0] == soft and row[2] == "without"]
    (_, _, hip, hip_friction, hip_valid), (_, _, slide, *_) = cells[:5], cells[5:]
    assert max(hip.value, slide.value) < 1.0
    assert hip_friction.value < 1.0, "13 % where sigma does not learn that it is soft"
    assert hip_valid.value > 95.0
    drawn = {how: cells for name, _, how, *cells in rows if name.startswith("all samples")}
    for how in ("without", "with"):
        for error, sigma, beyond, *_ in (drawn[how][:5], drawn[how][5:]):
            assert sigma.value < 2.5 * error.value
            # One machine of thirty may be off by three times what its file states.
            assert beyond.value < (1.0 if how == "with" else 100.0 / 30)


@pytest.mark.parametrize(("refused", "needless"), [("two optima", ""), ("", "the file is as good")])
def test_bristles_that_the_command_would_not_write_are_not_compared(monkeypatch, refused, needless):
    made = SimpleNamespace(refused=refused, needless=needless, why_eq_11="")
    run = SimpleNamespace(time_s=np.zeros(1), measured=np.zeros((1, 2)), exerted=np.zeros((1, 2)))
    machine = SimpleNamespace(
        play=lambda *_: SimpleNamespace(run=run, trouble=""),
        longest_s=lambda _: 1.0,
        settings=SimpleNamespace(robot=None),
    )
    monkeypatch.setattr(study, "EmptyMachine", lambda *_: machine)
    monkeypatch.setattr(study, "calibrate", lambda *_, **__: made)

    with pytest.raises(RecordingError, match=refused or needless):
        study.cases(CONFIGS / "demo.toml", [1], lambda _: lambda _: None)
