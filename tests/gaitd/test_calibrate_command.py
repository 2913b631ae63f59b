import subprocess
import sys
from pathlib import Path

import pytest
from empty_runs import ROBOT_FILE, empty_run, robot_file, shipped_friction, write_csv

from analysis.calibration.robot_file import RobotFileError, rewritten, write
from daemon.config.settings import Robot
from daemon.config.strict import load_toml


def gaitd(*arguments: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gaitd", *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_calibration_writes_a_robot_file_and_a_page(tmp_path):
    recorded = write_csv(empty_run(shipped_friction()), tmp_path / "run.csv")
    before = tmp_path / "before.toml"
    text = ROBOT_FILE.read_text().replace("coulomb_nm = 6.0", "coulomb_nm = 4.0")
    before.write_text(text)

    ran = gaitd("calibrate", recorded, "--robot", before, "--page", tmp_path, folder=tmp_path)

    assert ran.returncode == 0, ran.stderr
    after = load_toml(tmp_path / "run.csv.robot.toml", Robot)
    assert after.friction.hip.coulomb_nm == pytest.approx(6.0, rel=0.02)
    assert after.geometry == robot_file().geometry
    assert before.read_text() == text
    assert "calibration_friction.png" in (tmp_path / "calibration.md").read_text()


def test_only_the_named_numbers_change(tmp_path):
    output = tmp_path / "out.toml"

    write(ROBOT_FILE, output, {"friction.hip.coulomb_nm": (5.5, "calibrated from x")})

    pairs = zip(ROBOT_FILE.read_text().splitlines(), output.read_text().splitlines(), strict=True)
    differing = [new for old, new in pairs if old != new]
    assert differing == ["coulomb_nm = 5.5  # calibrated from x"]


def test_the_input_is_never_overwritten_and_an_unknown_key_is_named():
    with pytest.raises(RobotFileError, match="another name"):
        write(ROBOT_FILE, ROBOT_FILE, {})
    with pytest.raises(RobotFileError, match=r"friction\.knee"):
        rewritten(ROBOT_FILE.read_text(), {"friction.knee": (1.0, "")})


def test_check_tells_a_wrong_recline_by_its_exit_code(tmp_path):
    recorded = write_csv(empty_run(shipped_friction()), tmp_path / "run.csv")
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(ROBOT_FILE.read_text().replace("recline_deg = 60.0", "recline_deg = 70.0"))

    good = gaitd("calibrate", recorded, "--robot", ROBOT_FILE, "--check", folder=tmp_path)
    bad = gaitd("calibrate", recorded, "--robot", wrong, "--check", folder=tmp_path)

    assert good.returncode == 0, good.stderr
    assert bad.returncode == 1
    assert "recline" in bad.stdout
