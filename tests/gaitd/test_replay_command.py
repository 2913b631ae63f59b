import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

CONFIGS = Path(__file__).parents[2] / "configs"


def gaitd(*arguments: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gaitd", *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


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

    assert ran.returncode == 0, ran.stderr
    rows = out.read_text().splitlines()
    assert len(rows) == 301
    assert rows[0].startswith("time_s,hip_angle_rad,")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "300 rows" in ran.stdout
    assert "missing      1 samples" in ran.stdout
    assert "x real time" in ran.stdout


def test_without_an_output_the_estimates_lie_beside_the_recording(recorded, tmp_path):
    ran = gaitd("replay", recorded, folder=tmp_path)

    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "recorded.csv.estimates.csv").exists()
    assert "configs/robot.toml" in ran.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["missing.csv"], "missing.csv: No such file"),
        (["recorded.csv", "--robot", "nobody.toml"], "nobody.toml"),
        (["recorded.csv", "--output", "no/such/folder/out.csv"], "no/such/folder/out.csv"),
    ],
)
def test_what_cannot_be_used_is_named_and_the_exit_code_is_two(recorded, tmp_path, arguments, said):
    ran = gaitd("replay", *arguments, folder=tmp_path)

    assert ran.returncode == 2
    assert said in ran.stderr
    assert "Traceback" not in ran.stderr
