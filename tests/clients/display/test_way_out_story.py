"""The way out of a stop, alone: through the display's server, the gateway and the core.

The leg moves by the physics of the virtual drives, in simulated time. First with keys and a gait
of 30 % of the shipped one, so that the springs carry the leg in every pose: it drifts by less than
a degree. Then without keys and as shipped, where the page must not offer RESET; this story begins
with the daily test of the emergency stop, after which START leads on.
"""

import contextlib
import re
import shutil
import tempfile
from pathlib import Path

import display_bench as bench
import msgspec
import pytest
from gaitd_client import Mode, Trainer
from gaitd_display.patient import PatientServer
from gaitd_display.settings import PatientSettings
from gaitd_display.way_out import Pose, Release, WhyNot
from gaitd_session import Advice
from keyed_trainer import TrainerWithKeys
from processes import CONFIGS
from starlette.testclient import TestClient
from training import PROFILE

from daemon.preflight.acceptance import check_files
from gaitd_lab.processes import memory_folder

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
    harmonics = re.compile(r"((?:hip|knee)\.harmonics_deg = )(\[.*?\n\])", re.DOTALL)
    file.write_text(harmonics.sub(smaller, text), encoding="utf-8")
    return folder


def written_check(trainer_file, path):
    """What `gaitd check --json` prints for a file."""
    _, report, errors = check_files(trainer_file)
    assert not errors
    path.write_bytes(msgspec.json.encode(report))


@contextlib.contextmanager
def shown(machine, table, folder, **credentials):
    """The patient's page of a machine: what its browser gets, and how it posts."""
    trainer = Trainer(machine.endpoint, trainer=machine.trainer, clock=machine.clock, **credentials)
    settings = bench.settings_of(folder, table, PatientSettings)
    server = PatientServer(settings, trainer, machine.clock)
    with (
        TestClient(server.app, base_url=bench.ORIGIN) as client,
        client.websocket_connect("/live", headers=bench.OURS) as socket,
    ):
        page = bench.Page(socket)
        page.server, page.settings = server, settings
        page.post = lambda path, **body: client.post(path, headers=bench.OURS, json=body)
        yield page


def pressed(page, action):
    page.until(lambda now: now["action"] == action)
    return page.post("/act", action=action).json()["outcome"]


def positions(machine):
    return [drive.position for drive in machine.newest().drives]


def moved(machine, since):
    return [abs(now - then) for now, then in zip(positions(machine), since, strict=True)]


def test_a_person_alone_gets_from_a_stop_to_where_the_straps_can_be_opened(
    gentle_configs, tmp_path
):
    """With keys, and with a server that starts again behind RESET."""
    table = bench.patient_table(tmp_path)
    clients = {"operator.desk": False, "session.patient": False}
    with (
        tempfile.TemporaryDirectory(dir=memory_folder()) as folder,
        TrainerWithKeys(Path(folder), clients, gentle_configs) as machine,
    ):
        machine.start_all()
        written_check(machine.config, tmp_path / "check.json")
        by_keys = {"credentials": machine.credentials("session.patient")}
        machine.gait(cadence_hz=0.3)
        with shown(machine, table, tmp_path, **by_keys) as page:
            page.until(lambda now: now["word"] in {"go_on", "more", "good", "gently"})
            assert page.post("/stop").json()["outcome"] == "done"
            machine.wait_for(Mode.FAULT)
            stopped_at = positions(machine)
            for drive in DRIVES:
                machine.tell(f"hand_switch_open {drive}")
            page.until(lambda now: now["step"] == "switch")
            assert page.post("/act", action="reset").status_code == 409
            machine.act_as("session.patient")
            refused = machine.request("reset")
            assert (refused["outcome"], refused["refusal"]["code"]) == (
                "refused",
                "hand_switch_open",
            )
            for drive in DRIVES:
                machine.tell(f"clear hand_switch_open {drive}")

            assert pressed(page, "reset") == "done"
            machine.wait_for(Mode.READY)
        with shown(machine, table, tmp_path, **by_keys) as page:
            while pressed(page, "enable") == "refused":  # while the leg sinks into its springs
                machine.run(0.5)
            machine.wait_for(Mode.HOLD)
            hip_moved_rad, slide_moved_m = moved(machine, stopped_at)
            assert hip_moved_rad < 0.0175  # one degree
            assert slide_moved_m < 0.01
            machine.until(machine.stands)
            assert pressed(page, "hand_guiding") == "done"
            machine.wait_for(Mode.HAND_GUIDING)
            assert pressed(page, "hold") == "done"
            machine.wait_for(Mode.HOLD)
            assert page.until(lambda now: now["mode"] == Mode.HOLD)["step"] == "guide"


@pytest.mark.thorough
def test_the_daily_test_is_led_by_the_page_and_the_shipped_machine_is_not_released_alone(
    virtual_trainers, tmp_path
):
    """Without keys, and with the shipped gait, whose springs do not carry the leg everywhere."""
    machine = virtual_trainers({"demo.toml": {"self_test.required": "daily"}})
    table = bench.session_table(tmp_path, PROFILE)
    written_check(machine.config, tmp_path / "check.json")
    acts = {
        Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT: "sto_open * 0.5",
        Advice.LET_GO_AND_HOLD_HAND_SWITCH: "hand_switch_open * 0.5",
    }
    done, stops = set(), []
    with shown(machine, table, tmp_path) as page:

        def led(now):
            """Do what the page says, as a patient does."""
            machine.run(0.1)
            training = now["training"]
            if training is None:
                return False
            if now["cause"] is not None:
                stops.append((now["step"], now["cause"], now["alarm"]))
            if training["advice"] in acts and training["advice"] not in done:
                done.add(training["advice"])
                machine.tell(acts[training["advice"]])
                machine.run(1.0)
            elif "start" in training["buttons"]:
                page.post("/session", button="start")
            return now["word"] == "soon" and now["mode"] == Mode.HOLD

        page.until(led)
        # The first frames of the stop may be older than the drive's next message.
        assert stops[-1] == ("start", "sto_active", None)
        assert {alarm for *_, alarm in stops} == {None}

        assert page.post("/stop").json()["outcome"] == "done"
        machine.wait_for(Mode.FAULT)
        now = page.until(lambda now: now["mode"] == Mode.FAULT and now["step"] != "none")
        assert (now["step"], now["action"], now["training"]["buttons"]) == ("help", None, [])
        assert now["scene"]["strips"][0]["text"]["key"] == "last.held"
        assert now["scene"]["cards"][-1]["title"]["key"] == "help"
        assert now["alarm"] is not None
        assert page.post("/act", action="reset").status_code == 409
        assert page.post("/session", button="start").status_code == 409
        release, configuration = Release(page.settings.way_out), page.server.state.configuration
        poses = (Pose(*positions(machine)),)
        assert release.why_not("stop_requested", configuration, poses) is WhyNot.DRIFT

        machine.reset()  # by a helper who has come
        now = page.until(lambda now: now["mode"] == Mode.READY and now["word"] != "ready")
        assert (now["word"], now["step"], now["action"]) == ("start", "none", None)
