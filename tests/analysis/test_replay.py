"""Replay against what was published, against itself, and against files that are no recording."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
from gaitd_toml import load_toml
from records import states_of
from sessions import new_session

from analysis.recording import RecordingError
from analysis.replay import estimate, read, read_ring
from daemon.config.settings import Robot
from daemon.ipc.transport import RING_NAME, RingHeader, RingWriter
from gaitd_lab.lockstep import LockstepSession

CONFIGS = Path(__file__).parents[2] / "configs"
ROBOT = load_toml(CONFIGS / "robot.toml", Robot)
HEADER = ["time_s", "hip_angle_rad", "slide_position_m", "hip_torque_nm", "slide_force_n"]


@pytest.fixture(scope="module")
def session() -> LockstepSession:
    return new_session().walk(duration_s=4.0)


@pytest.fixture(scope="module")
def ring(session, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("ring") / RING_NAME
    import msgspec

    header = RingHeader(
        core_boot_id="test",
        start_utc_ns=0,
        period_ns=10_000_000,
        trainer="trainer",
        drive_names=("right/hip", "right/slide"),
        leg_names=("right",),
        config_hashes={},
        version="test",
        robot=msgspec.to_builtins(ROBOT),
        limits={},
    )
    writer = RingWriter(path, header)
    for record in session.records:
        writer.write(record)
    writer.close()
    return path


def test_a_black_box_is_replayed_with_its_own_robot_to_what_was_published(session, ring):
    source = read(ring)
    made = estimate(source, source.robot)

    records = session.records[-len(source.recording.time_s) :]
    published = np.array([states_of(record.legs[0]) for record in records])
    status = np.array([record.legs[0].status for record in records])
    assert source.robot == ROBOT
    assert (np.abs(made.state - published)[-100:] < 1e-3 * made.std[-100:]).all()
    assert np.array_equal(made.status[-100:], status[-100:])


def test_a_csv_of_the_same_session_gives_the_same_estimates(session, ring, tmp_path):
    path = tmp_path / "session.csv"
    from_ring = read(ring)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        made = from_ring.recording
        for time_s, position, effort in zip(made.time_s, made.position, made.effort, strict=True):
            writer.writerow([repr(float(value)) for value in (time_s, *position, *effort)])
    path.write_text(path.read_text().replace("nan", ""))

    a = estimate(from_ring, ROBOT)
    b = estimate(read(path), ROBOT)

    assert np.array_equal(a.state, b.state, equal_nan=True)


def test_words_about_the_progress_change_no_bit(ring, monkeypatch):
    told: list[float] = []
    whole = estimate(read(ring), ROBOT)
    monkeypatch.setattr("observer.offline.batch.BLOCK_ROWS", 100)

    parts = estimate(read(ring), ROBOT, told.append)

    assert parts.state.tobytes() == whole.state.tobytes()
    assert parts.status.tobytes() == whole.status.tobytes()
    assert told[-1] == 1.0
    assert len(told) > 5


def test_the_truth_of_the_virtual_drives_is_a_recording_too(session, tmp_path):
    path = tmp_path / "truth.csv"
    rows = session.truth.rows
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(rows[0]._fields)
        writer.writerows(rows)

    made = estimate(read(path), ROBOT)

    friction = np.array([row.hip_friction_nm for row in rows])
    assert np.corrcoef(made.state[-200:, 4], friction[-200:])[0, 1] > 0.98


def test_a_leg_that_is_not_there_is_refused_by_name(ring):
    with pytest.raises(RecordingError, match="has no leg left, only right"):
        read_ring(ring, "left")


@pytest.mark.parametrize(
    ("content", "said"), [(b"", "is empty"), (b"hello" * 9000, "begins with"), (None, "No such")]
)
def test_a_file_that_is_no_ring_is_refused(tmp_path, content, said):
    path = tmp_path / "something.bin"
    if content is not None:
        path.write_bytes(content)

    with pytest.raises(RecordingError, match=said):
        read(path)


def test_a_ring_in_which_the_observer_never_ran_is_refused(ring, tmp_path):
    shutil.copy(ring, tmp_path / "empty.ring")
    from daemon.ipc.transport import RingReader

    header = RingReader(ring).header
    RingWriter(tmp_path / "empty.ring", header).close()

    with pytest.raises(RecordingError, match="the observer ran in none of its 0 records"):
        read(tmp_path / "empty.ring")
