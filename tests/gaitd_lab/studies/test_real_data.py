"""The study of real recordings: on a simulated axis in the benchmark's files, and on the real one.

The estimators that are no Kalman filters are compared with scipy's filters of the true force.
"""

import json

import numpy as np
import pytest
from command_line import gaitd
from gaitd_toml import load_toml
from one_axis import (
    CONSTANT_N,
    COULOMB_N,
    ENCODER_M,
    MASS_KG,
    SLIDE_M,
    one_axis_samples,
)
from scipy.io import savemat
from scipy.signal import butter, lfilter
from sessions import CONFIGS

from analysis.calibration import session
from analysis.calibration.fit import STARTS
from analysis.recording import RecordingError
from daemon.config.settings import Robot
from gaitd_lab.studies.real_data import hip_moment, strides
from gaitd_lab.studies.real_data.classical import Axis, inverse_dynamics, momentum_observer
from gaitd_lab.studies.real_data.comparison import (
    CALIBRATED,
    INVERSE,
    MOMENTUM,
    NOISE,
    PAPER,
    PUBLISHED,
    SMOOTHED_NOISE,
    compare,
)
from gaitd_lab.studies.real_data.emps import FILES, read
from gaitd_lab.studies.real_data.measured_patient import NAME, patient
from gaitd_lab.studies.real_data.study import axis_table
from gaitd_lab.trials import Situation, Trials
from observer.mechanism.friction import FrictionParameters
from sim_drives.plant.recorded import read_strides

FIT = session._fit
GAIN_N_PER_V = 35.15
PULSE_V = 5.07
ROWS = 1500
STEP_S = 0.01
CONFIG = CONFIGS / "demo.toml"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Two records in the benchmark's files, the second with pulses whose height it rounds."""
    folder = tmp_path_factory.mktemp("recordings")
    (folder / "emps").mkdir()
    on = np.arange(10 * ROWS) // 503 % 2
    for seed, (name, pulses) in enumerate(zip(FILES, (0 * on, on), strict=True)):
        rng = np.random.default_rng(seed)
        position_m, force_n = one_axis_samples(ROWS, rng, pulses * PULSE_V * GAIN_N_PER_V)
        made = {
            "qm": position_m[:-1, None] - SLIDE_M + rng.normal(size=(len(on), 1)) * ENCODER_M,
            "vir": force_n[:, None] / GAIN_N_PER_V,
            "gtau": GAIN_N_PER_V,
        }
        if pulses.any():
            made["pulses_N"] = (5 * pulses[:, None]).astype(np.uint8)
        savemat(folder / "emps" / name, made)
    write_walk(folder)
    return folder


def write_walk(folder):
    """Three strides in the file of the measured hip moment, each stronger than the one before."""
    phase = np.linspace(0.0, 2.0 * np.pi, 100)
    swing = np.repeat((20.0 * np.cos(phase))[:, None], 3, axis=1)
    moment = -np.sin(phase + 0.3)[:, None] * np.array((10.0, 20.0, 30.0))
    heads = np.array(["knee_angle", "hip_flexion"], dtype=object)
    tables = [np.stack((np.zeros((100, 3)), one), axis=1) for one in (swing, moment)]
    angles, moments = ({"all": one, "colheaders": heads} for one in tables)
    measured = {"Q": {"subject1": {"Qs": angles}}, "Torques": {"subject1": moments}}
    (folder / "gait_falisse").mkdir()
    savemat(folder / "gait_falisse" / hip_moment.FILE, {"ExperimentalData": measured})


def by_name(head, rows):
    """The cells of a table by estimator and column."""
    return {name: dict(zip(head[1:], cells, strict=True)) for name, *cells in rows}


def fit_without_bristles(start, given, *more):
    """A fit of the law of the given file; none of bristles."""
    if start is not given:
        raise RecordingError("bristles are left out")
    return FIT(start, given, *more)


@pytest.fixture(scope="module")
def tables(recordings, tmp_path_factory):
    """What the command prints as JSON."""
    output = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        # Other starts, searches that go on, and bristles are those of tests/analysis.
        patch.setattr("analysis.calibration.fit.START_ENCODERS", (1.0,))
        patch.setattr("analysis.calibration.fit.STARTS", STARTS[:1])
        patch.setattr("analysis.calibration.fit.STEPS_MAX", 6)
        patch.setattr("analysis.calibration.fit.FINE_SUBSTEPS", 5)
        patch.setattr("analysis.calibration.session._fit", fit_without_bristles)
        patch.setattr("gaitd_lab.studies.real_data.measured_patient.SEEDS", 1)
        patch.setattr("gaitd_lab.studies.real_data.measured_patient.STRIDES", 8)
        patch.setattr("gaitd_lab.studies.real_data.study.CADENCES_HZ", (0.5,))
        patch.setattr("gaitd_lab.studies.report.DPI", 20)
        ran = gaitd("real-data", recordings, "--output", output, "--json")
    assert ran.code == 0, ran.err
    assert {path.name for path in output.iterdir()} == {
        *("real_data.md", "real_data_slide.png", "real_data_speed.png")
    }
    return json.loads(ran.out)


@pytest.fixture(scope="module")
def found(tables):
    return by_name(tables[0]["head"], tables[0]["rows"])


def test_the_height_and_the_times_of_the_pulses_are_the_true_ones(recordings):
    clean, disturbed = read(recordings / "emps")

    assert not clean.pulses_n.any()
    assert disturbed.pulses_n.max() == pytest.approx(PULSE_V * GAIN_N_PER_V, rel=0.02)
    assert disturbed.edges_s[:2] == pytest.approx([0.503, 1.006])
    assert disturbed.pulses_n[50] == pytest.approx(0.7 * disturbed.pulses_n.max())


def test_a_pulse_is_found_and_sigma_covers_the_error(found):
    for name in (CALIBRATED, NOISE):
        assert found[name]["as disturbance, N"] < 2.0
        assert found[name]["no pulses, N"] < 1.5
        assert found[name]["3σ"] >= 0.99
        assert found[name]["σ, N"] < found[PUBLISHED]["σ, N"]
    assert found[NOISE]["50 ms, N"] < 2.0  # no rate of the edge is carried on
    assert found[NOISE]["NIS"] == pytest.approx(1.0, abs=0.15)
    assert found[CALIBRATED]["NIS"] < 0.3
    assert found[SMOOTHED_NOISE]["3σ"] >= 0.99
    assert found[PUBLISHED]["× gaitd"] > 1.0


def test_the_others_are_as_fast_to_ninety_percent(found):
    for name in (MOMENTUM, INVERSE):
        assert found[name]["90 %, ms"] == pytest.approx(found[NOISE]["90 %, ms"], abs=1)
        assert found[name]["as disturbance, N"] < 4.0
        assert found[name]["σ, N"] is None


@pytest.mark.parametrize("method", [momentum_observer, inverse_dynamics])
def test_a_classical_estimator_is_its_low_pass_of_the_true_force(method):
    """Without friction, and with forces that are constant over a row, by scipy's filters."""
    rng = np.random.default_rng(3)
    drive_n, patient_n = (40.0 * rng.normal(size=300).cumsum() for _ in range(2))
    acceleration = (drive_n + patient_n) / 20.0
    velocity = np.concatenate(([0.0], np.cumsum(STEP_S * acceleration)))
    position = np.concatenate(
        ([0.0], np.cumsum(STEP_S * velocity[:-1] + 0.5 * STEP_S**2 * acceleration))
    )
    # Row k + 1 has the position after the force of its row.
    axis = Axis(20.0, FrictionParameters(1e-9, 1e-12, 1e-12, 1.0, 1.0, 1.0, 1.0), STEP_S)

    made = method(axis, position, np.concatenate(([0.0], drive_n)), 30.0)

    # A velocity's difference belongs to the halves of two rows.
    seen_n = 0.5 * (patient_n[1:] + patient_n[:-1])
    if method is momentum_observer:
        pole = np.exp(-30.0 * STEP_S)
        expected = lfilter([1.0 - pole], [1.0, -pole], seen_n)
    else:
        expected = lfilter(*butter(2, 30.0, fs=2.0 * np.pi / STEP_S), seen_n)
    assert made[2:] == pytest.approx(expected, abs=1e-6 * np.abs(patient_n).max())


def test_calibration_finds_the_axis(tables):
    values = {name: value for name, value, _ in tables[1]["rows"]}

    assert values["mass, kg"] == pytest.approx(MASS_KG, rel=0.01)
    assert values["Coulomb friction, N"] == pytest.approx(COULOMB_N, rel=0.05)
    assert values["constant force, N"] == pytest.approx(CONSTANT_N, abs=0.3)


def test_strides_of_a_measured_patient_are_found(tables):
    """The plant's torque has the strength of each stride of the file in turn."""
    (cells,) = tables[2]["rows"]
    row = dict(zip(tables[2]["head"], cells, strict=True))
    true, error = row["true work with the motion"], row["error of the work"]

    assert (row["cadence"], row["seeds"]) == ("0.5 Hz", "1")
    assert int(row["strides"]) >= 3
    assert true["value_high"] > 1.5 * true["value_low"]  # counted from another phase on
    assert max(-error["value_low"], error["value_high"]) < 6.0
    assert row["correlation of found and true work"] > 0.99


def test_the_measured_hip_moment_is_written_for_a_patient(recordings, tmp_path):
    ran = gaitd("real-data", recordings, "--patient", tmp_path / "moment.csv")

    assert ran.code == 0, ran.err
    made = read_strides(tmp_path / "moment.csv")
    theta = np.linspace(-np.pi, np.pi, 100, endpoint=False)
    for stride, size in zip(made, (1 / 3, 2 / 3, 1.0), strict=True):
        assert stride[:, 0] == pytest.approx(-size * np.sin(theta + 0.3), abs=0.01)
    assert not made[:, :, 1].any()


def test_files_that_are_none_of_the_benchmark_are_refused(recordings, tmp_path):
    folder = tmp_path / "emps"
    folder.mkdir()
    first, second = (folder / name for name in FILES)
    good = (recordings / "emps" / FILES[0]).read_bytes()

    def refusal():
        ran = gaitd("real-data", tmp_path)
        assert ran.code == 2
        return ran.err

    assert f"{first}: No such file" in refusal()
    first.write_text("time_s,vir\n")
    assert f"{first}: is no MATLAB file of version 7" in refusal()
    savemat(first, {"qm": np.zeros(9), "vir": np.zeros(9)})
    assert "lacks the variable gtau; it has qm, vir" in refusal()
    savemat(first, {"qm": np.zeros(99), "vir": np.zeros(98), "gtau": 1.0})
    assert "qm has 99 samples and vir 98" in refusal()
    savemat(first, {"qm": np.full(99, np.nan), "vir": np.zeros(99), "gtau": 1.0})
    assert "qm must be finite numbers" in refusal()
    first.write_bytes(good)
    second.write_bytes(good)
    assert f"{second}: pulses_N is 0 throughout" in refusal()
    second.write_bytes((recordings / "emps" / FILES[1]).read_bytes())
    write_walk(tmp_path)
    savemat(tmp_path / "gait_falisse" / hip_moment.FILE, {"ExperimentalData": {"Q": 1.0}})
    assert "lacks ExperimentalData.Q.subject1.Qs with the joint hip_flexion" in refusal()


@pytest.fixture
def real(request):
    folder = request.config.getoption("recordings")
    if folder is None:
        pytest.skip("needs --recordings=FOLDER")
    return folder


def test_strides_with_the_measured_hip_moment_are_right_within_six_percent(real, tmp_path):
    file = tmp_path / "moment.csv"
    hip_moment.write(hip_moment.read(real / "gait_falisse" / hip_moment.FILE), file)
    trials = Trials(CONFIG, programmes=(patient(file),))

    trial = trials.gait(Situation(cadence_hz=0.5, programme=NAME), 30.0)

    assert not trial.ended
    found = strides.judged(trial)
    assert len(found) >= 10
    for one in found:
        assert one.work_j == pytest.approx(one.true_work_j, rel=0.06)
        assert one.share_ratio == pytest.approx(one.true_share_ratio, abs=0.01)
    assert len({round(one.true_work_j, 2) for one in found[:10]}) > 5


def test_on_the_recorded_axis_all_that_was_asked_is_met(real):
    robot = load_toml(CONFIGS / "robot_empty.toml", Robot)
    table = axis_table(compare(read(real / "emps"), robot))

    found = by_name(table.head, table.rows)
    first = found[PUBLISHED]
    assert first["no pulses, N"] == pytest.approx(2.1, abs=0.05)
    assert first["pulses left in, N"] == pytest.approx(2.4, abs=0.05)
    assert first["as disturbance, N"] == pytest.approx(2.6, abs=0.05)
    for name in (CALIBRATED, NOISE, PAPER):
        assert found[name]["as disturbance, N"] < 2.0
        assert found[name]["3σ"] >= 0.99
        assert found[name]["σ, N"] <= first["σ, N"]
    assert 0.94 <= found[NOISE]["NIS"] <= 1.06
    assert found[NOISE]["3σ, reversals"] >= 0.99
    assert found[SMOOTHED_NOISE]["3σ, reversals"] >= 0.99
    for name in (MOMENTUM, INVERSE):
        assert found[name]["as disturbance, N"] > found[NOISE]["as disturbance, N"]
