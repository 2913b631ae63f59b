"""A patient with measured efforts: what the file says at a phase is what the joint feels there."""

import math

import numpy as np
import pytest
from config_files import Change, changed, copied
from gaitd_toml import ConfigError

from daemon.config.trainer import load_trainer
from gaitd_lab.virtual_machine import virtual_machine
from sim_drives.plant.patient import STRIDE, compile_programme, script
from sim_drives.plant.recorded import SAMPLES, RecordedError, read_strides
from sim_drives.plant.settings import HipEffort, Programme, Recorded, SlideEffort

HEAD = "stride_index,stride_ratio,hip_angle_rad,hip_torque_nm,slide_force_n"
LAG_RAD = 0.8
SIZES = (10.0, 25.0, 40.0)


def torque(theta_rad):
    return np.cos(theta_rad + 0.4) + 0.5 * np.sin(3.0 * theta_rad)


def rows():
    """Strides that begin at another phase than the plant's, each stronger than the one before."""
    for index, size in enumerate(SIZES):
        for ratio in np.arange(200) / 200:
            theta_rad = 2.0 * math.pi * ratio - LAG_RAD
            angle_rad = 0.1 + 0.3 * math.cos(theta_rad)
            yield (index, ratio, angle_rad, size * torque(theta_rad), size * math.sin(theta_rad))


def written(path, lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def file(tmp_path):
    lines = (",".join(f"{value:.9g}" for value in row) for row in rows())
    return written(tmp_path / "strides.csv", [HEAD, *lines])


def programme():
    flanks = {"at_s": 0.0, "until_s": 1e6, "rise_s": 0.0, "fall_s": 0.0}
    effort = Recorded(
        **flanks, hip=HipEffort(torque_nm=8.0), slide=SlideEffort(force_n=-30.0), file="strides.csv"
    )
    return Programme("measured", effort=(effort,))


def test_the_strides_of_a_file_act_in_turn_at_the_phase_at_which_they_were_measured(file):
    strides = read_strides(file)
    table, _ = compile_programme(programme(), {"strides.csv": strides})
    theta_rad = np.linspace(-math.pi, 9.0 * math.pi, 3000, endpoint=False)
    oscillator, felt, out = np.zeros(1, STRIDE), [], np.zeros(2)
    for one in theta_rad:
        oscillator["in_phase_rad"], oscillator["quadrature_rad"] = math.cos(one), math.sin(one)
        script(table, oscillator[0], 1.0, np.zeros(2), out)
        felt.append(out.copy())

    sizes = np.array(SIZES)[((theta_rad + math.pi) // (2.0 * math.pi)).astype(int) % 3]
    largest = max(SIZES) * np.abs(torque(theta_rad)).max()
    inside = np.abs((theta_rad + math.pi) % (2.0 * math.pi) - math.pi) < math.pi * (1 - 2 / SAMPLES)
    hip_nm, slide_n = np.array(felt)[inside].T
    expected = 8.0 * sizes * torque(theta_rad) / largest
    assert hip_nm == pytest.approx(expected[inside], abs=0.05)
    assert slide_n == pytest.approx((-30.0 * sizes / 40.0 * np.sin(theta_rad))[inside], abs=0.1)


def test_a_resting_leg_feels_nothing_of_it(file):
    table, _ = compile_programme(programme(), {"strides.csv": read_strides(file)})
    out = np.ones(2)

    script(table, np.zeros(1, STRIDE)[0], 1.0, np.zeros(2), out)

    assert not out.any()


@pytest.mark.parametrize(
    ("change", "refusal"),
    [
        (lambda lines: [], "is empty"),
        (
            lambda lines: ["stride_index,ratio", *lines[1:]],
            "line 1: lacks column stride_ratio, hip",
        ),
        (lambda lines: [*lines[:4], "0,0.02,?,1,0", *lines[5:]], "line 5: hip_angle_rad is '?'"),
        (lambda lines: [*lines[:4], "0,0.02", *lines[5:]], "line 5: hip_angle_rad is ''"),
        (lambda lines: [*lines[:4], "0,0.02,24,1,0", *lines[5:]], "24; allowed is -2.2 to 2.2 rad"),
        (lambda lines: [*lines[:4], lines[3], *lines[5:]], "line 5: stride_ratio is 0.01; it must"),
        (lambda lines: lines[:201:11], "stride_index 0 has 18 rows; at least 20"),
        (lambda lines: lines[:1], "has 0 strides; allowed are 1 to 16"),
        (
            lambda lines: [HEAD, *(f"0,{row / 50},0.1,{row},0" for row in range(50))],
            "hip_angle_rad swings by 0.0 deg",
        ),
        (
            lambda lines: [HEAD, *(f"0,{r / 50},{math.cos(r / 8):.3f},0,0" for r in range(50))],
            "hip_torque_nm is 0 in every row",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_its_place(file, change, refusal):
    lines = file.read_text(encoding="utf-8").splitlines()

    with pytest.raises(RecordedError) as found:
        read_strides(written(file, change(lines)))

    assert refusal in str(found.value)


@pytest.mark.parametrize(
    ("name", "slide_n", "allowed"),
    [
        ("absent.csv", "0.0", r"a CSV of strides \(no such file"),
        ("demo.toml", "0.0", "line 1: lacks column"),
        ("hip.csv", "5.0", "a file with slide_force_n, because slide.force_n is not 0"),
    ],
)
def test_the_virtual_drives_name_plant_and_programme_of_a_bad_file(
    tmp_path, name, slide_n, allowed
):
    configs = copied(tmp_path)
    hip_only = (",".join(f"{value:.9g}" for value in row[:4]) for row in rows())
    written(configs / "hip.csv", [HEAD.rpartition(",")[0], *hip_only])
    text = f"""[[patient.programme]]
name = "measured"

[[patient.programme.effort]]
kind = "recorded"
file = "{name}"
at_s = 0.0
until_s = 60.0
rise_s = 0.0
fall_s = 0.0
hip.torque_nm = 8.0
slide.force_n = {slide_n}

[[patient.programme]]
name = "passive"
"""
    old = '[[patient.programme]]\nname = "passive"\n'
    config = changed(configs, Change("plant.toml", old, text))

    with pytest.raises(ConfigError, match=allowed) as found:
        virtual_machine(load_trainer(config))

    assert f'plant.toml: patient.programme.measured.file = "{name}"' in str(found.value)
