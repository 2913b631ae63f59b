from pathlib import Path

import numpy as np
import pytest
from command_line import gaitd
from config_files import CONFIGS


@pytest.fixture
def recorded(tmp_path) -> Path:
    path = tmp_path / "recorded.csv"
    lines = ["time_s,hip_angle_rad,slide_position_m,hip_torque_nm,slide_force_n"]
    for row in range(300):
        swing = np.sin(row / 60)
        lines.append(f"{row * 0.01:.2f},{0.24 + 0.1 * swing},{0.59 + 0.1 * swing},5,60")
    lines[100] = lines[100].split(",")[0] + ",,,5,60"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_replay_writes_the_estimates_and_draws_the_picture(recorded, tmp_path):
    out, picture = tmp_path / "out.csv", tmp_path / "picture.png"
    robot = CONFIGS / "robot.toml"

    ran = gaitd(
        "replay", recorded, "--robot", robot, "--output", out, "--plot", picture, folder=tmp_path
    )

    assert ran.code == 0, ran.err
    rows = out.read_text().splitlines()
    assert len(rows) == 301
    assert rows[0].startswith("time_s,hip_angle_rad,")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "300 rows" in ran.out
    assert "missing      1 samples" in ran.out
    assert "x real time" in ran.out
    assert "friction     hip:" in ran.out
    assert "friction     slide:" in ran.out


def test_without_an_output_the_estimates_lie_beside_the_recording(recorded, tmp_path):
    ran = gaitd("replay", recorded, folder=tmp_path)

    assert ran.code == 0, ran.err
    assert (tmp_path / "recorded.csv.estimates.csv").exists()
    assert "configs/robot.toml" in ran.out


def test_a_table_of_the_five_columns_is_replayed_though_its_robot_is_of_an_older_version(tmp_path):
    file = Path(__file__).parent / "public_cases/five_columns.parquet"

    ran = gaitd("replay", file, "--output", tmp_path / "out.csv", folder=tmp_path)

    assert ran.code == 0, ran.err
    assert "1500 rows" in ran.out
    assert "robot        not that of the file:" in ran.out
    assert "configs/robot.toml" in ran.out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["missing.csv"], "missing.csv: No such file"),
        (["recorded.csv", "--robot", "missing.toml"], "missing.toml"),
        (
            ["recorded.csv", "--output", "no/such/folder/out.csv"],
            "there is no folder no/such/folder",
        ),
        (["recorded.csv", "--plot", "picture.jpg"], "--plot picture.jpg: must end in .png"),
        (["recorded.csv", "--plot", "no/p.png"], "--plot no/p.png: there is no folder no"),
        (["recorded.csv", "--output", "a.png", "--plot", "a.png"], "is the file of --output too"),
        (["recorded.csv", "--output", "recorded.csv"], "is the recording itself"),
        (["recorded.csv", "--robot", "robot.toml", "--strides", "robot.toml"], "is an input, too"),
        (["."], ".: has no file LEG.recording.parquet"),
        (["recorded.csv", "missing.csv"], "missing.csv: No such file"),
        (
            ["recorded.csv", "recorded.csv", "--output", "a.csv"],
            "--output a.csv: must be an existing",
        ),
        (["recorded.csv", "recorded.csv"], "is the file of --output too"),
        (["notes.txt"], "a recording is a .csv, a folder of `gaitd record`, or a ring"),
        (["notes.txt", "--publish"], "only a ring of records can be published"),
        (["notes.ring.xz", "--publish"], "notes.ring.xz: is no xz file"),
    ],
)
def test_what_cannot_be_used_is_named_and_the_exit_code_is_two(recorded, tmp_path, arguments, said):
    (tmp_path / "notes.txt").write_text("not a recording, but long enough to be looked at\n" * 500)
    (tmp_path / "notes.ring.xz").write_text("not compressed")
    (tmp_path / "robot.toml").write_bytes((CONFIGS / "robot.toml").read_bytes())
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    ran = gaitd("replay", *arguments, folder=tmp_path)

    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert ran.code == 2
    assert said in ran.err
    assert "Traceback" not in ran.err


def test_nothing_is_written_when_the_recording_is_refused(recorded, tmp_path):
    out = tmp_path / "out.csv"
    out.write_text("of another day")
    recorded.write_text(recorded.read_text().replace("0.29,", "0.19,", 1))

    ran = gaitd("replay", recorded, "--output", out, folder=tmp_path)

    assert ran.code == 2
    assert "time_s goes from" in ran.err
    assert out.read_text() == "of another day"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.csv", "recorded.csv"]


def test_a_typo_in_the_robot_file_is_named_and_nothing_is_written(recorded, tmp_path):
    robot = tmp_path / "robot.toml"
    robot.write_text(
        (CONFIGS / "robot.toml").read_text().replace("gravity", "gravitty") + "\nx = 1\n"
    )

    ran = gaitd("replay", recorded, "--robot", robot, folder=tmp_path)

    assert ran.code == 2
    assert f"{robot}: " in ran.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recorded.csv", "robot.toml"]


def test_a_robot_file_that_the_service_refuses_is_refused(recorded, tmp_path):
    robot = tmp_path / "robot.toml"
    text = (CONFIGS / "robot.toml").read_text()
    given = "bristle_stiffness_n_per_m = 0.0"
    assert given in text
    robot.write_text(text.replace(given, "bristle_stiffness_n_per_m = 1e5"))

    ran = gaitd("replay", recorded, "--robot", robot, folder=tmp_path)

    assert ran.code == 2
    assert f"{robot}: observer.integrator = rk4: semi_implicit" in ran.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recorded.csv", "robot.toml"]


def test_several_recordings_have_their_results_in_one_folder(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.replay_figure.draw", lambda *its: its[-1].touch())
    folder = tmp_path / "results"
    folder.mkdir()
    other = recorded.with_name("other.csv")
    other.write_bytes(recorded.read_bytes())

    ran = gaitd(
        *("replay", recorded, other, "--output", folder, "--plot", folder, "--strides", folder),
        folder=tmp_path,
    )

    assert ran.code == 0, ran.err
    assert sorted(path.name for path in folder.iterdir()) == [
        *("other.csv.estimates.csv", "other.csv.png", "other.csv.strides.csv"),
        *("recorded.csv.estimates.csv", "recorded.csv.png", "recorded.csv.strides.csv"),
    ]
    first, second = (folder / f"{name}.csv.estimates.csv" for name in ("other", "recorded"))
    assert first.read_bytes() == second.read_bytes()


def test_the_same_recording_gives_the_same_bytes_again_and_nothing_else(recorded, tmp_path):
    written: list[bytes] = []
    for _ in range(2):
        assert gaitd("replay", recorded, "--smooth", folder=tmp_path).code == 0
        written.append((tmp_path / "recorded.csv.estimates.csv").read_bytes())

    assert written[0] == written[1]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "recorded.csv",
        "recorded.csv.estimates.csv",
    ]


def test_estimates_may_go_where_no_file_can_take_their_place(recorded, tmp_path):
    ran = gaitd("replay", recorded, "--output", "/dev/null", folder=tmp_path)

    assert ran.code == 0, ran.err
    assert Path("/dev/null").is_char_device()
