"""`gaitd commission` and `gaitd reference` as people run them, through real processes."""

import json
import tempfile
from pathlib import Path

import pytest
from processes import Service
from sessions import changed_configs

from daemon.ipc.record import Mode
from daemon.ipc.state_file import NAME
from gaitd_lab.processes import memory_folder


@pytest.fixture(scope="module")
def service():
    with tempfile.TemporaryDirectory(dir=memory_folder()) as name:
        folder = Path(name)
        configs = changed_configs(
            folder,
            ("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
            ("plant.toml", '"robot.toml"', '"robot_empty.toml"'),
            ("demo.toml", 'signs = "assumed"', 'signs = "proven"'),
        )
        service = Service(folder, configs, pace=20.0)
        try:
            service.start_all()
            service.until(lambda record: record.mode == Mode.READY, 90)
            service.wait(lambda: service.ask("status").returncode == 0, 90)
            yield service
        finally:
            service.end()


def test_an_axis_that_does_not_exist_is_refused_with_those_that_do(service):
    refused = service.ask("reference", "left/knee")

    assert refused.returncode == 1
    assert "right/hip, right/slide" in refused.stdout


def test_a_sign_is_proven_kept_and_found_again_by_the_next_start(service):
    refused = service.ask("enable")
    assert refused.returncode == 1
    assert "sign is not proven" in refused.stdout

    proven = service.ask("commission", "right/hip", "--witnessed")
    assert proven.returncode == 0, proven.stdout + proven.stderr
    assert "the thigh is first raised" in proven.stdout
    assert "moves with its torque: pushed forth" in proven.stdout
    service.until(lambda record: record.drives[0].sign_proven)

    service.kill("core")
    service.start("core")
    again = service.until(lambda record: record.mode == Mode.READY and record.drives[0].fresh, 40)

    service.wait(lambda: service.ask("status").returncode == 0, 20)
    assert again.drives[0].sign_proven
    assert not again.drives[1].sign_proven
    kept = json.loads((service.folder / "state" / NAME).read_text())
    assert kept["axes"]["right/hip"]["proof"]["serial_number"] == 305_000_005


def test_a_state_directory_that_cannot_be_written_is_a_configuration_error(tmp_path):
    service = Service(tmp_path)
    text = service.config.read_text()
    state = f'state = "{service.folder}/state"'
    assert state in text
    service.config.write_text(text.replace(state, 'state = "/proc/no/such/place"'))

    ended = service.ask("core")

    assert ended.returncode == 2
    assert "paths.state" in ended.stderr
