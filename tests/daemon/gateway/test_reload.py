"""SIGHUP: what changes in a running gateway, and what is only named."""

import hashlib
import logging
import shutil
from pathlib import Path

import pytest
from gaitd_toml import ConfigError

from daemon.config.trainer import load_trainer
from daemon.gateway.events import Priority
from daemon.gateway.lease import LeaseManager
from daemon.gateway.reload import Reload
from daemon.zenoh_io import endpoints

CONFIGS = Path(__file__).parents[3] / "configs"


class Running:
    """A gateway's configuration, as far as a reload is concerned."""

    def __init__(self, folder):
        self.configs = folder / "configs"
        shutil.copytree(CONFIGS, self.configs)
        self.path = self.configs / "demo.toml"
        file = self.read(self.path)
        self.desk = LeaseManager(file.trainer.lease)
        self.reload = Reload(file, self.read)
        self.hashes = {
            str(path): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in (self.path, self.configs / "robot.toml", self.configs / "limits.toml")
        }

    @staticmethod
    def read(path):
        return endpoints.check(load_trainer(path))

    def change(self, name, old, new):
        file = self.configs / name
        text = file.read_text()
        assert old in text
        file.write_text(text.replace(old, new))

    def hang_up(self):
        self.reload.request()
        return self.reload.turn(self.desk, self.hashes)


@pytest.fixture
def running(tmp_path):
    level = logging.getLogger().level
    yield Running(tmp_path)
    logging.getLogger().setLevel(level)


def test_without_a_request_to_reload_no_file_is_read(running):
    running.path.unlink()

    assert running.reload.turn(running.desk, running.hashes) == []


def test_a_reload_is_done_once_for_each_time_that_it_is_asked_for(running):
    assert len(running.hang_up()) == 1
    assert running.reload.turn(running.desk, running.hashes) == []


def test_a_file_as_before_changes_nothing(running):
    [said] = running.hang_up()

    assert (said.code, said.said) == ("config_reloaded", "-")
    assert said.priority is Priority.INFO
    assert running.reload.needs_restart == ""


def test_lease_and_log_level_are_taken_over(running):
    running.change("demo.toml", "duration_ms = 500", "duration_ms = 700")
    running.change("demo.toml", "[lease]", '[log]\nlevel = "error"\n\n[lease]')

    [said] = running.hang_up()

    assert said.said == "log, lease"
    assert running.hang_up()[0].said == "-"
    assert running.desk.rules.duration_ms == 700
    assert logging.getLogger().level == logging.ERROR


def test_a_lease_that_is_held_keeps_its_rules_and_the_next_reload_takes_them(running):
    number = running.desk.acquire("controller", None, None, 0).number
    running.change("demo.toml", "duration_ms = 500", "duration_ms = 700")

    [said] = running.hang_up()
    assert "lease unchanged while controller holds it" in said.said
    assert running.desk.rules.duration_ms == 500

    running.desk.release("controller", number)
    [said] = running.hang_up()
    assert running.desk.rules.duration_ms == 700
    assert said.said == "lease"


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("duration_ms = 500", "duration_ms = 5", "lease.duration_ms"),
        ("duration_ms = 500", "duration = 500", "lease.duration"),
        ('"tcp/127.0.0.1:7447"', '"tcp/192.168.1.5:7447"', "zenoh.listen"),
    ],
)
def test_a_wrong_file_is_refused_in_the_words_of_check_and_the_old_one_stays(
    running, old, new, key
):
    running.change("demo.toml", "duration_max_ms = 5000", "duration_max_ms = 6000")
    running.change("demo.toml", old, new)

    [said] = running.hang_up()

    with pytest.raises(ConfigError) as error:
        Running.read(running.path)
    assert (said.code, said.said) == ("config_refused", str(error.value))
    assert key in said.said
    assert said.priority is Priority.MEDIUM
    assert running.desk.rules.duration_max_ms == 5000


def test_endpoints_need_a_restart_of_the_gateway_and_motion_one_of_the_core(running):
    running.change("demo.toml", "tcp/127.0.0.1:7447", "tcp/127.0.0.1:7448")
    running.change("demo.toml", "cadence_max_hz = 0.5", "cadence_max_hz = 0.4")
    running.change("limits.toml", "[hip]", "[hip]  # looked at")

    [said] = running.hang_up()

    assert "needs a restart of the gateway: zenoh" in said.said
    assert "a restart of the core on the empty machine: gait, limits.toml" in said.said
    assert said.priority is Priority.LOW
    assert running.reload.needs_restart


def test_what_was_changed_back_needs_no_restart_any_more(running):
    running.change("limits.toml", "[hip]", "[hip]  # looked at")
    running.hang_up()
    running.change("limits.toml", "[hip]  # looked at", "[hip]")

    running.hang_up()

    assert running.reload.needs_restart == ""


def test_a_file_of_the_core_that_is_gone_is_named(running):
    (running.configs / "robot.toml").unlink()

    [said] = running.hang_up()

    assert "robot.toml" in said.said
