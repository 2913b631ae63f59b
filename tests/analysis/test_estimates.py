import csv

import numpy as np
import pytest

from analysis.estimates import COLUMNS, write_csv
from observer.filter.states import STATE_NAMES
from observer.filter.status import Validity
from observer.offline.batch import BatchEstimates


def times(count: int = 4) -> np.ndarray:
    return 1.7e9 + np.arange(count) * 0.01


def made(count: int = 4) -> BatchEstimates:
    draw = np.random.default_rng(7).normal
    return BatchEstimates(
        covariance=draw(size=(count, 36)),
        innovation=draw(size=(count, 2)),
        state=draw(size=(count, 8)),
        std=np.abs(draw(size=(count, 8))),
        net=draw(size=(count, 2)),
        net_std=np.abs(draw(size=(count, 2))),
        nis=np.abs(draw(size=count)),
        status=np.arange(count, dtype=np.int64) * 0x101,
        validity=np.zeros((count, 2), dtype=np.int64),
        unsure=np.zeros((count, 0)),
    )


def rows_of(path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_columns_are_those_of_the_interface(tmp_path):
    write_csv(times(), made(), tmp_path / "out.csv")

    header = (tmp_path / "out.csv").read_text().splitlines()[0]
    assert header == (
        "time_s,hip_angle_rad,slide_position_m,hip_velocity_rad_per_s,slide_velocity_m_per_s,"
        "hip_friction_nm,slide_friction_n,hip_patient_nm,slide_patient_n,"
        "hip_angle_rad_std,slide_position_m_std,hip_velocity_rad_per_s_std,"
        "slide_velocity_m_per_s_std,hip_friction_nm_std,slide_friction_n_std,hip_patient_nm_std,"
        "slide_patient_n_std,hip_net_nm,slide_net_n,nis,"
        "hip_validity,slide_validity,status"
    )


def test_the_numbers_are_those_that_were_computed(tmp_path):
    estimates = made()

    write_csv(times(), estimates, tmp_path / "out.csv")

    rows = rows_of(tmp_path / "out.csv")
    assert [float(row["time_s"]) for row in rows] == times().tolist()
    for index, state in enumerate(STATE_NAMES):
        written = [float(row[state]) for row in rows]
        assert written == pytest.approx(estimates.state[:, index], rel=1e-8)
    assert [row["status"] for row in rows] == ["0x0000", "0x0101", "0x0202", "0x0303"]


def test_a_number_that_is_not_there_is_an_empty_cell(tmp_path):
    estimates = made()
    estimates.nis[1] = np.nan
    estimates.net[2, 1] = np.nan

    write_csv(times(), estimates, tmp_path / "out.csv")

    rows = rows_of(tmp_path / "out.csv")
    assert rows[1]["nis"] == ""
    assert rows[2]["slide_net_n"] == ""
    assert all(set(row) == set(COLUMNS) for row in rows)


def test_an_axis_at_rest_has_no_split_and_a_bad_one_has_no_number(tmp_path):
    estimates = made()
    estimates.validity[1] = Validity.SPLIT_UNOBSERVABLE, Validity.OK
    estimates.validity[2] = Validity.OK, Validity.BAD

    write_csv(times(), estimates, tmp_path / "out.csv")

    rows = rows_of(tmp_path / "out.csv")
    empty = [{name for name, cell in row.items() if not cell} for row in rows]
    split = {"hip_friction_nm", "hip_friction_nm_std", "hip_patient_nm", "hip_patient_nm_std"}
    slide = {name for name in COLUMNS if name.startswith("slide_")} - {"slide_validity"}
    assert empty == [set(), split, slide, set()]
    assert [(row["hip_validity"], row["slide_validity"]) for row in rows] == [
        ("ok", "ok"),
        ("split_unobservable", "ok"),
        ("ok", "bad"),
        ("ok", "ok"),
    ]


def test_the_same_estimates_make_the_same_file(tmp_path):
    write_csv(times(20_000), made(20_000), tmp_path / "a.csv")
    write_csv(times(20_000), made(20_000), tmp_path / "b.csv")

    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
