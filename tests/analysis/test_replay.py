"""Replay against the service itself: the black box of a session gives the session's estimates."""

import subprocess
import sys

import numpy as np
import pytest
from sessions import CONFIGS, Session

from analysis.estimates import write_csv
from analysis.replay import estimate, read
from daemon.core.build import ring_header
from daemon.seam import RING_NAME, RingWriter


@pytest.fixture(scope="module")
def session():
    return Session().walking(warm_s=5)


@pytest.fixture(scope="module")
def ring(session, tmp_path_factory):
    path = tmp_path_factory.mktemp("box") / RING_NAME
    writer = RingWriter(path, ring_header(session.settings, "lockstep", 0, "test"))
    for record in session.lockstep.records:
        writer.write(record)
    writer.close()
    return path


def test_the_black_box_replays_to_what_the_service_had_estimated(session, ring):
    source = read(ring)

    again = estimate(source, source.robot)

    live = [r.legs[0] for r in session.lockstep.records if np.isfinite(r.legs[0].measured[0])]
    states = np.array([leg.state for leg in live])[-500:]
    # The service began one cycle into its first sample, so the two agree to what a start leaves.
    assert again.state[-500:] == pytest.approx(states, abs=0.1, nan_ok=True)
    assert again.state[-500:, :2] == pytest.approx(states[:, :2], abs=1e-6, nan_ok=True)


def test_a_replay_gives_the_same_bytes_every_time(ring, tmp_path):
    source = read(ring)
    for name in ("first", "second"):
        write_csv(source.recording.time_s, estimate(source, source.robot), tmp_path / name)

    assert (tmp_path / "first").read_bytes() == (tmp_path / "second").read_bytes()


def test_the_truth_of_the_virtual_drives_is_a_recording_that_replay_reads(session, tmp_path):
    rows = session.truth.rows[60:]
    names = ("time_s", "hip_angle_rad", "slide_position_m", "hip_torque_nm", "slide_force_n")
    path = tmp_path / "truth.csv"
    lines = [",".join(str(getattr(row, name)) for name in names) for row in rows]
    path.write_text("\n".join([",".join(names), *lines]) + "\n")

    finished = subprocess.run(
        [
            *(sys.executable, "-m", "gaitd", "replay", str(path)),
            *("--robot", str(CONFIGS / "robot.toml"), "--plot", str(tmp_path / "plot.png")),
        ],
        capture_output=True,
        text=True,
        check=False,
    )

    assert finished.returncode == 0, finished.stderr
    assert (tmp_path / "plot.png").stat().st_size > 10_000
    header = (tmp_path / "truth.csv.estimates.csv").read_text().splitlines()[0].split(",")
    for column in ("hip_patient_nm", "slide_patient_n_std", "hip_net_nm", "nis", "status"):
        assert column in header


def test_a_recording_in_degrees_is_refused_with_a_word(tmp_path):
    path = tmp_path / "degrees.csv"
    header = "time_s,hip_angle_rad,slide_position_m,hip_torque_nm,slide_force_n"
    rows = [f"{k * 0.01},{14 + 10 * np.sin(k * 0.05)},0.5,1.0,10.0" for k in range(300)]
    path.write_text("\n".join([header, *rows]) + "\n")

    finished = subprocess.run(
        [sys.executable, "-m", "gaitd", "replay", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )

    assert finished.returncode == 2
    assert "degrees.csv" in finished.stderr
    assert "hip_angle_rad" in finished.stderr
