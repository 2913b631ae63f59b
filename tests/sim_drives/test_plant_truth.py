"""The truth beside the service: readable as a recording, complete at every moment."""

import csv

import pytest
from trainers import MS, programme, run, torque, trainer

from sim_drives.plant.truth import TruthLog, TruthRow

RECORDING = ("time_s", "hip_angle_rad", "slide_position_m", "hip_torque_nm", "slide_force_n")


def session(log, cycles=20):
    plant = trainer(
        patient=programme({"kind": "steady", "hip.torque_nm": 3.0, "slide.force_n": -20.0})
    )
    for sync in range(cycles):
        log.record(sync, plant.truth())
        torque(plant, 5.0 + sync, 50.0)
        run(plant, 0.01)
    return plant


def test_the_file_begins_with_the_columns_of_a_recording(tmp_path):
    log = TruthLog(tmp_path / "truth.csv")
    session(log)
    log.close()

    rows = list(csv.DictReader((tmp_path / "truth.csv").open()))

    assert tuple(rows[0])[:5] == RECORDING
    assert [float(row["time_s"]) for row in rows[:3]] == pytest.approx([0.0, 0.01, 0.02])
    assert len(rows) == 20


def test_every_row_is_there_as_soon_as_it_is_recorded(tmp_path):
    path = tmp_path / "truth.csv"
    log = TruthLog(path)
    plant = trainer()
    for count in range(1, 4):
        log.record(count, plant.truth())
        text = path.read_text()
        assert text.endswith("\n")
        assert len(text.splitlines()) == 1 + count
        run(plant, 0.01)
    log.close()


def test_torque_is_the_mean_since_the_row_before():
    log = TruthLog(None)
    plant = session(log)

    first, later = log.rows[0], log.rows[1:]

    assert first.hip_torque_nm == 0.0
    total = sum(row.hip_torque_nm * 0.01 for row in later)
    assert total == pytest.approx(plant.truth().effort_impulse[0] - 0.01 * 24.0, abs=0.02)
    assert later[10].hip_torque_nm == pytest.approx(5.0 + 10, abs=0.2)


def test_net_is_patient_minus_friction_in_every_row():
    log = TruthLog(None)
    session(log)

    for row in log.rows:
        assert row.hip_net_nm == row.hip_patient_nm - row.hip_friction_nm
        assert row.slide_net_n == row.slide_patient_n - row.slide_friction_n
    assert log.rows[-1].hip_patient_nm == 3.0


def test_a_row_knows_its_sync_and_its_instant():
    log = TruthLog(None)
    session(log)

    assert [row.sync_count for row in log.rows] == list(range(20))
    assert [row.sync_mono_ns for row in log.rows] == [10 * MS * k for k in range(20)]


def test_a_simulator_that_runs_for_hours_keeps_no_rows_in_memory(tmp_path):
    log = TruthLog(tmp_path / "truth.csv", keep_rows=False)
    session(log)
    log.close()

    assert log.rows == []


def test_the_columns_are_the_fields_of_a_row(tmp_path):
    log = TruthLog(tmp_path / "truth.csv")
    log.close()

    assert (tmp_path / "truth.csv").read_text().strip().split(",") == list(TruthRow._fields)
