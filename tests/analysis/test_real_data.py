"""The page of real recordings: on a simulated axis in the benchmark's files, and on the real one.

The estimators that are no Kalman filters are compared with scipy's filters of the true force.
"""

import numpy as np
import pytest
from command_line import gaitd
from one_axis import ENCODER_M, SLIDE_M, one_axis_samples
from scipy.io import savemat
from scipy.signal import butter, lfilter

from analysis.real_data.classical import Axis, inverse_dynamics, momentum_observer
from analysis.real_data.comparison import CALIBRATED, INVERSE, MOMENTUM, NOISE, PAPER, PUBLISHED
from analysis.real_data.emps import FILES, read
from analysis.real_data.page import HEAD
from observer.mechanism.friction import FrictionParameters

GAIN_N_PER_V = 35.15
PULSE_V = 5.07
ROWS = 1500
STEP_S = 0.01


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
    return folder


def judged(page):
    """Cells of the page's table by estimator and head, as numbers; NaN for a dash."""
    lines = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("|")]
    rows = [cells for cells in lines if len(cells) == len(HEAD) and cells[1][-1:].isdigit()]
    return {
        name: dict(zip(HEAD[1:], (float(cell.replace("–", "nan")) for cell in cells), strict=True))
        for name, *cells in rows
    }


@pytest.fixture(scope="module")
def found(recordings, tmp_path_factory):
    output = tmp_path_factory.mktemp("page")
    ran = gaitd("real-data", recordings, "--output", output)
    assert ran.code == 0, ran.err
    assert {path.name for path in output.iterdir()} == {
        *("real_data.md", "real_data_slide.png", "real_data_speed.png")
    }
    return judged((output / "real_data.md").read_text(encoding="utf-8"))


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
    assert found[NOISE]["NIS"] == pytest.approx(1.0, abs=0.15)
    assert found[CALIBRATED]["NIS"] < 0.3
    assert found[PUBLISHED]["× gaitd"] > 1.0


def test_the_others_are_as_fast_to_ninety_percent(found):
    for name in (MOMENTUM, INVERSE):
        assert found[name]["90 %, ms"] == pytest.approx(found[NOISE]["90 %, ms"], abs=1)
        assert found[name]["as disturbance, N"] < 4.0
        assert np.isnan(found[name]["σ, N"])


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


def test_on_the_recorded_axis_all_that_was_asked_is_met_while_it_moves(request, tmp_path):
    folder = request.config.getoption("recordings")
    if folder is None:
        pytest.skip("needs --recordings=FOLDER")

    ran = gaitd("real-data", folder, "--output", tmp_path)

    assert ran.code == 0, ran.err
    found = judged((tmp_path / "real_data.md").read_text(encoding="utf-8"))
    first = found[PUBLISHED]
    assert first["no pulses, N"] == pytest.approx(2.1, abs=0.05)
    assert first["pulses left in, N"] == pytest.approx(2.4, abs=0.05)
    assert first["as disturbance, N"] == pytest.approx(2.6, abs=0.05)
    for name in (CALIBRATED, NOISE, PAPER):
        assert found[name]["as disturbance, N"] < 2.0
        assert found[name]["3σ"] >= 0.99
        assert found[name]["σ, N"] <= first["σ, N"]
    assert 0.94 <= found[NOISE]["NIS"] <= 1.06
    for name in (MOMENTUM, INVERSE):
        assert found[name]["as disturbance, N"] > found[NOISE]["as disturbance, N"]
