"""Strides of a recording as a table and as a picture."""

import csv
import math

import numpy as np
import pytest

from analysis import stride_figure, stride_table
from analysis.replay_report import stride_lines
from observer.filter.leg_observer import setup_of
from observer.offline.smooth_batch import run_smoothed
from observer.strides import AxisStride, strides_of
from tests.observer.trainer import (
    HIP,
    PATIENT,
    SLIDE_FRICTION,
    TUNING,
    encoded,
    gait,
    simulate,
)


@pytest.fixture(scope="module")
def walked():
    cycles = 1300
    path = gait(PATIENT, np.maximum(np.arange(1, cycles + 1) * 0.01 - 1.0, 0.0), 0.5)
    columns = encoded(simulate(PATIENT, cycles, reference=path, start=path[0]))
    smooth = run_smoothed(setup_of(PATIENT, HIP, SLIDE_FRICTION, TUNING), columns)
    return columns, smooth, strides_of(smooth, columns)


def test_each_stride_is_a_row_and_each_figure_a_column_with_its_sigma(walked, tmp_path):
    columns, _, found = walked
    out = tmp_path / "strides.csv"

    stride_table.write_csv([(float(columns.time_s[row]), one) for row, one in found], out)

    rows = list(csv.DictReader(out.open()))
    assert len(rows) == len(found) >= 4
    assert list(rows[0]) == stride_table.columns()
    for number, (row, (first, stride)) in enumerate(zip(rows, found, strict=True), start=1):
        assert int(row["number"]) == number
        assert float(row["begin_s"]) == pytest.approx(columns.time_s[first])
        assert float(row["hip_work_positive_j"]) == pytest.approx(stride.hip.work_positive_j)
        assert float(row["slide_power_peak_w_std"]) == pytest.approx(stride.slide.power_peak_w_std)
        assert float(row["slide_coverage_ratio"]) == pytest.approx(stride.slide.coverage_ratio)
        assert float(row["work_negative_j"]) == pytest.approx(stride.work_negative_j)
        assert int(row["status"], 16) == stride.status


def test_a_share_that_there_is_not_is_an_empty_cell(walked, tmp_path):
    _, _, found = walked
    out = tmp_path / "strides.csv"
    stride = found[0][1]._replace(share_ratio=None, share_ratio_std=None)

    stride_table.write_csv([(0.0, stride)], out)

    (row,) = csv.DictReader(out.open())
    assert row["share_ratio"] == row["share_ratio_std"] == ""


def test_the_picture_is_drawn_for_no_strides(walked):
    columns, smooth, _ = walked

    assert len(stride_figure.draw([], columns.time_s, smooth).axes) == 4


def test_an_axis_without_figures_has_empty_cells_no_bar_and_no_part_in_the_mean(walked, tmp_path):
    columns, smooth, found = walked
    figures = (math.nan,) * 12
    blind = AxisStride(*figures, None, None, 0.98)
    first, *others = found
    hurt = first[1]._replace(slide=blind, work_positive_j=math.nan, work_positive_j_std=math.nan)
    *others, (last_row, last) = others
    seldom = last._replace(hip=last.hip._replace(coverage_ratio=0.49))
    others = [*others, (last_row, seldom)]
    strides = [(first[0], hurt), *others]
    out = tmp_path / "strides.csv"

    stride_table.write_csv([(0.0, stride) for _, stride in strides], out)
    figure = stride_figure.draw(strides, columns.time_s, smooth)
    figure.savefig(tmp_path / "strides.png")
    assert len(figure.axes) == 4
    assert (tmp_path / "strides.png").stat().st_size > 10_000
    lines = list(stride_lines(strides, (out, None)))

    row, *_, last = csv.DictReader(out.open())
    assert row["slide_work_positive_j"] == row["slide_share_ratio"] == row["work_positive_j"] == ""
    assert (row["slide_coverage_ratio"], row["hip_work_positive_j"] == "") == ("0.98", False)
    assert [(one["hip_validity"], one["slide_validity"]) for one in (row, last)] == [
        ("ok", "bad"),
        ("split_unobservable", "ok"),
    ]
    mean_j = sum(stride.slide.work_positive_j for _, stride in others) / len(others)
    assert f" and {mean_j:.2f} J a stride" in lines[-1]
