"""The way out of a stop, alone: through the display's server, the gateway and the core.

The leg moves by the physics of the virtual drives, in simulated time. The gait is 30 % of the
shipped one, so that the springs carry the leg in every pose: it drifts by less than a degree.
The last story is the daily test of the emergency stop, after which START leads on.
"""

import re
import shutil

import display_bench as bench
import msgspec
import pytest
from gaitd_client import Mode, Trainer
from gaitd_display.patient import PatientServer
from gaitd_display.settings import PatientSettings, WayOutRules
from gaitd_display.way_out import Pose, Release, WhyNot
from gaitd_session import Advice
from processes import CONFIGS
from starlette.testclient import TestClient
from training import PROFILE

from daemon.ipc.record import Mode as CoreMode
from daemon.preflight.acceptance import check_files

GAIT_RATIO = 0.3
DRIVES = ("right/hip", "right/slide")


@pytest.fixture
def gentle_configs(tmp_path):
    """The shipped files with a smaller gait."""
    folder = shutil.copytree(CONFIGS, tmp_path / "configs")
    file = folder / "demo.toml"

    def smaller(table):
        numbers = re.sub(
            r"-?\d+\.\d+", lambda it: f"{float(it.group()) * GAIT_RATIO:.4f}", table.group(2)
        )
        return table.group(1) + numbers

    text = file.read_text(encoding="utf-8")
    harmonics = re.compile(r"((?:hip|knee)_harmonics_deg = )(\[.*?\n\])", re.DOTALL)
    file.write_text(harmonics.sub(smaller, text), encoding="utf-8")
    return folder


def written_check(trainer_file, path):
    """What `gaitd check --json` prints for a file."""
    _, report, refusal = check_files(trainer_file)
    assert refusal is None
    path.write_bytes(msgspec.json.encode(report))
    return report


def test_the_shipped_machine_drifts_too_far_for_a_reset_without_a_second_person(tmp_path):
    report = written_check(CONFIGS / "demo.toml", tmp_path / "check.json")
    rules = WayOutRules(
        check=tmp_path / "check.json", hip_drift_max_deg=1.0, slide_drift_max_m=0.01
    )
    configuration = bench.filled(
        bench.Configuration, config_hashes=report.sha256, limits={}, robot={}, leg_names=["right"]
    )
    poses = (Pose(0.24, 0.59),)

    assert Release(rules).why_not("spasm", configuration, poses) is WhyNot.DRIFT


def test_a_person_alone_gets_from_a_stop_to_where_the_straps_can_be_opened(
    virtual_trainers, gentle_configs, tmp_path
):
    machine = virtual_trainers(configs=gentle_configs)
    table = bench.patient_table(tmp_path)
    written_check(machine.config, tmp_path / "check.json")
    trainer = Trainer(machine.endpoint, trainer=machine.trainer, clock=machine.clock)
    server = PatientServer(
        bench.settings_of(tmp_path, table, PatientSettings), trainer, trainer.clock
    )
    machine.gait(cadence_hz=0.3)
    with (
        TestClient(server.app, base_url=bench.ORIGIN) as client,
        client.websocket_connect("/live", headers=bench.OURS) as socket,
    ):
        page = bench.Page(socket)

        def press(action):
            page.until(lambda now: now["action"] == action)
            return client.post("/act", headers=bench.OURS, json={"action": action}).json()

        page.until(lambda now: now["word"] in {"go_on", "stronger", "good", "gently"})
        assert client.post("/stop", headers=bench.OURS, json={}).json()["outcome"] == "done"
        machine.wait_for(CoreMode.FAULT)
        stopped_at = [drive.position_si for drive in machine.newest().drives]
        for drive in DRIVES:
            machine.tell(f"hand_switch_open {drive}")
        page.until(lambda now: now["step"] == "switch")
        assert client.post("/act", headers=bench.OURS, json={"action": "reset"}).status_code == 409
        for drive in DRIVES:
            machine.tell(f"clear hand_switch_open {drive}")

        assert press("reset")["outcome"] == "done"
        machine.wait_for(CoreMode.READY)
        page.until(lambda now: now["action"] == "enable")
        while press("enable")["outcome"] == "refused":  # while the leg sinks into its springs
            machine.run(0.5)
        machine.wait_for(CoreMode.HOLD)
        moved = [
            abs(drive.position_si - before)
            for drive, before in zip(machine.newest().drives, stopped_at, strict=True)
        ]
        assert moved[0] < 0.0175  # one degree
        assert moved[1] < 0.01
        machine.until(machine.stands)
        assert press("hand_guiding")["outcome"] == "done"
        machine.wait_for(CoreMode.HAND_GUIDING)
        assert press("hold")["outcome"] == "done"
        machine.wait_for(CoreMode.HOLD)
        assert page.until(lambda now: now["mode"] == Mode.HOLD)["step"] == "guide"


def test_the_daily_test_of_hand_switch_and_emergency_stop_is_led_by_the_page(
    virtual_trainers, tmp_path
):
    machine = virtual_trainers({"demo.toml": {"self_test.required": "daily"}})
    (tmp_path / "profile.toml").write_text(PROFILE, encoding="utf-8")
    table = bench.patient_table(tmp_path, way_out=False)
    table["session"] = {"profile": "profile.toml", "history": "history.sqlite"}
    trainer = Trainer(machine.endpoint, trainer=machine.trainer, clock=machine.clock)
    settings = bench.settings_of(tmp_path, table, PatientSettings)
    server = PatientServer(settings, trainer, machine.clock)
    acts = {
        Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT: "sto_open * 0.5",
        Advice.LET_GO_AND_HOLD_HAND_SWITCH: "hand_switch_open * 0.5",
    }
    done, shown = set(), []
    with (
        TestClient(server.app, base_url=bench.ORIGIN) as client,
        client.websocket_connect("/live", headers=bench.OURS) as socket,
    ):
        page = bench.Page(socket)

        def led(now):
            """Do what the page says, as a patient does."""
            machine.run(0.1)
            training = now["training"]
            if training is None:
                return False
            if now["stop"] is not None:
                shown.append((now["step"], now["stop"]["happened"]["en"], now["alarm"]))
            if training["advice"] in acts and training["advice"] not in done:
                done.add(training["advice"])
                machine.tell(acts[training["advice"]])
                machine.run(1.0)
            elif "start" in training["buttons"]:
                client.post("/session", headers=bench.OURS, json={"button": "start"})
            return now["word"] == "soon" and now["mode"] == Mode.HOLD

        page.until(led)
    # The first frames of the stop may be older than the drive's next message.
    assert shown[-1] == ("start", "The emergency stop was pressed.", None)
    assert {alarm for *_, alarm in shown} == {None}
