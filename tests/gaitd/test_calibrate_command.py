import json

import pytest
from command_line import gaitd
from empty_runs import ROBOT_FILE, empty_run, robot_file, shipped_friction, write_csv
from gaitd_toml import load_toml

from analysis.calibration.fit import STARTS
from analysis.calibration.robot_file import write
from daemon.config.edits import EditError
from daemon.config.settings import Robot


@pytest.fixture
def recorded(tmp_path):
    """Hardly more than the least that can be calibrated from; the slide rests."""
    run = empty_run(shipped_friction(), slide=False, duration_s=12.0)
    return write_csv(run, tmp_path / "run.csv")


def test_a_calibration_writes_a_robot_file_and_a_page(recorded, tmp_path, monkeypatch):
    # Other starts, and searches that go on, are those of tests/analysis.
    monkeypatch.setattr("analysis.calibration.fit.START_ENCODERS", (1.0,))
    monkeypatch.setattr("analysis.calibration.fit.STARTS", STARTS[2:])
    monkeypatch.setattr("analysis.calibration.fit.START_BRISTLES", ((1.0, 1.0, 1.0),))
    monkeypatch.setattr("analysis.calibration.fit.FINE_SUBSTEPS", 5)
    monkeypatch.setattr("analysis.calibration.fit.STEPS_MAX", 1)
    monkeypatch.setattr("analysis.calibration.fit.NOISE_STEPS_MAX", 1)
    before = tmp_path / "before.toml"
    text = ROBOT_FILE.read_text().replace("coulomb_nm = 6.0", "coulomb_nm = 9.0")  # no hump
    before.write_text(text)

    ran = gaitd("calibrate", recorded, "--robot", before, "--page", tmp_path, "--noise", "--json")

    assert ran.code == 0, ran.err
    document = json.loads(ran.out)
    found = {one["key"]: one["value"] for one in document["results"]}
    assert document["written"] == str(tmp_path / "run.csv.robot.toml")
    assert found["friction.hip.coulomb_nm"] == pytest.approx(6.0, rel=0.02)
    after = load_toml(tmp_path / "run.csv.robot.toml", Robot)
    assert after.observer.hip.process_friction_nm != robot_file().observer.hip.process_friction_nm
    assert after.observer.slide.process_patient_n == robot_file().observer.slide.process_patient_n
    assert after.friction.hip.coulomb_nm == pytest.approx(6.0, rel=0.02)
    assert after.friction.slide == robot_file().friction.slide
    assert after.geometry == robot_file().geometry
    assert before.read_text() == text
    assert "calibration_friction.png" in (tmp_path / "calibration.md").read_text()


def test_only_the_named_numbers_change(tmp_path):
    output = tmp_path / "out.toml"

    write(ROBOT_FILE, output, {"friction.hip.coulomb_nm": (5.5, "calibrated from x")})

    pairs = zip(ROBOT_FILE.read_text().splitlines(), output.read_text().splitlines(), strict=True)
    differing = [new for old, new in pairs if old != new]
    assert differing == ["coulomb_nm = 5.5  # calibrated from x"]


def test_an_accepted_result_says_so_in_the_file_until_the_next_calibration(tmp_path):
    accepted, again = tmp_path / "accepted.toml", tmp_path / "again.toml"
    value = {"friction.hip.coulomb_nm": (5.5, "calibrated from x")}

    write(ROBOT_FILE, accepted, value, [("false_effort", "2.3 N·m"), ("mechanism", "recline")])
    write(accepted, again, value)

    note = load_toml(accepted, Robot).calibration
    assert note is not None
    assert note.missed_limits == ("false_effort", "mechanism")
    assert "# false_effort: 2.3 N·m\n# mechanism: recline\n" in accepted.read_text()
    assert load_toml(again, Robot).calibration is None
    assert "recline:" not in again.read_text()
    assert accepted.read_text().startswith(again.read_text().rstrip())


def test_the_input_is_never_overwritten(recorded):
    ran = gaitd("calibrate", recorded, "--robot", ROBOT_FILE, "--output", ROBOT_FILE)

    assert ran.code == 2
    assert "another name" in ran.err


def test_an_unknown_key_is_named(tmp_path):
    with pytest.raises(EditError, match=r"friction\.knee"):
        write(ROBOT_FILE, tmp_path / "out.toml", {"friction.knee": (1.0, "")})


def test_line_ends_are_kept(tmp_path):
    given, output = tmp_path / "given.toml", tmp_path / "out.toml"
    given.write_bytes(ROBOT_FILE.read_bytes().replace(b"\n", b"\r\n"))

    write(given, output, {"friction.hip.coulomb_nm": (5.5, "x")})

    assert output.read_bytes().count(b"\r\n") == given.read_bytes().count(b"\n")


def test_check_tells_a_wrong_recline_by_its_exit_code(recorded, tmp_path):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(ROBOT_FILE.read_text().replace("recline_deg = 60.0", "recline_deg = 70.0"))

    good = gaitd("calibrate", recorded, "--robot", ROBOT_FILE, "--check")
    bad = gaitd("calibrate", recorded, "--robot", wrong, "--check")

    assert good.code == 0, good.err
    assert bad.code == 1
    assert "recline" in bad.out


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (("--noise",), "--noise = true"),
        (("--accept",), "--accept = true"),
        (("--page", "folder"), "--page"),
        (("--output", "out.toml"), "--output"),
        (("--held-out", "other.csv"), "--held-out"),
    ],
)
def test_an_option_that_needs_a_fit_is_refused_with_check(option, said):
    ran = gaitd("calibrate", "none.csv", "--robot", ROBOT_FILE, "--check", *option)

    assert ran.code == 2
    assert f"command line: {said}" in ran.err
    assert "not with --check" in ran.err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "bristle_stiffness_n_per_m = 0.0",
            "",
            "friction.slide.bristle_stiffness_n_per_m = (missing): "
            "add `bristle_stiffness_n_per_m = 0.0` to the table friction.slide",
        ),
        (
            "slide.law_n = 0.0",
            "",
            "observer.slide.law_n = (missing): add `law_n = 0.0` to the table observer.slide",
        ),
        (
            "bristle_stiffness_nm_per_rad = 0.0",
            "bristle_stiffness_nm_per_rad = 2e3",
            "observer.integrator = rk4: semi_implicit",
        ),
        (
            "bristle_damping_nm_s_per_rad = 0.0",
            "bristle_damping_nm_s_per_rad = 20.0",
            "friction.hip.bristle_damping_nm_s_per_rad = 20.0: "
            "0 while bristle_stiffness_nm_per_rad is 0",
        ),
    ],
)
def test_what_is_wrong_with_the_robot_file_is_said_before_a_recording_is_read(
    tmp_path, old, new, said
):
    robot = tmp_path / "given.toml"
    text = ROBOT_FILE.read_text()
    assert old in text
    robot.write_text(text.replace(old, new))

    ran = gaitd("calibrate", tmp_path / "none.csv", "--robot", robot, "--noise")

    assert ran.code == 2
    assert f"{robot}: {said}" in ran.err
