"""One process of a kind for each directory."""

import os
import subprocess
import sys

import pytest
from gaitd_toml import ConfigError

from daemon.system.lock import hold

HOLDER = """
import sys
from pathlib import Path
from daemon.system.lock import hold
with hold(Path("trainer.toml"), "paths.runtime", Path(sys.argv[1]), "core"):
    print("holds", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture
def other(tmp_path):
    """Another process that holds the directory for its core."""
    command = [sys.executable, "-c", HOLDER, str(tmp_path)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes) as process:
        assert process.stdout.readline() == b"holds\n"
        yield process
        process.kill()


def test_a_directory_is_made_and_held_with_the_pid_for_people(tmp_path):
    with hold(tmp_path / "trainer.toml", "paths.runtime", tmp_path / "a" / "b", "core"):
        assert (tmp_path / "a" / "b" / "core.lock").read_text() == f"{os.getpid()}\n"


def test_a_second_one_of_a_kind_is_refused_with_key_pid_and_lock(tmp_path, other):
    with (
        pytest.raises(ConfigError) as refused,
        hold(tmp_path / "trainer.toml", "paths.runtime", tmp_path, "core"),
    ):
        pass

    assert refused.value.key == "paths.runtime"
    assert f"a gaitd core with pid {other.pid} holds {tmp_path}/core.lock" in str(refused.value)


def test_the_other_kind_is_not_kept_out(tmp_path, other):
    with hold(tmp_path / "trainer.toml", "paths.runtime", tmp_path, "gateway"):
        assert other.poll() is None


def test_a_killed_holder_leaves_nothing_that_would_have_to_be_cleared_away(tmp_path, other):
    other.kill()
    other.wait()

    with hold(tmp_path / "trainer.toml", "paths.runtime", tmp_path, "core"):
        assert (tmp_path / "core.lock").read_text() == f"{os.getpid()}\n"


def test_what_the_system_says_of_a_directory_is_said_with_key_and_path(tmp_path):
    (tmp_path / "file").write_bytes(b"")

    with (
        pytest.raises(ConfigError, match=r"paths\.state.*can be written") as refused,
        hold(tmp_path / "trainer.toml", "paths.state", tmp_path / "file" / "state", "core"),
    ):
        pass
    assert str(tmp_path / "file") in str(refused.value)


def test_an_error_of_whoever_holds_it_stays_what_it_is(tmp_path):
    with (
        pytest.raises(FileNotFoundError),
        hold(tmp_path / "trainer.toml", "paths.runtime", tmp_path, "core"),
    ):
        (tmp_path / "nothing").read_bytes()
