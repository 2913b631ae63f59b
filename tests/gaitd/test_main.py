"""The command line as a whole: what there is, what it costs, how a configuration error ends."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from config_files import CONFIGS, Change, changed, copied

from gaitd.__main__ import COMMANDS

HEAVY = {"numba", "numpy", "scipy", "zenoh", "can", "canopen", "matplotlib", "plotext"}


def gaitd(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gaitd", *arguments], capture_output=True, text=True, check=False
    )


def test_help_lists_every_command_and_imports_nothing_heavy():
    listing = (
        "import contextlib, runpy, sys\n"
        "sys.argv = ['gaitd', '--help']\n"
        "with contextlib.suppress(SystemExit): runpy.run_module('gaitd', run_name='__main__')\n"
        f"print('heavy:', sorted({HEAVY!r} & set(sys.modules)))\n"
    )

    ran = subprocess.run(
        [sys.executable, "-c", listing], capture_output=True, text=True, check=True
    ).stdout

    assert "heavy: []" in ran
    for name in COMMANDS:
        assert f" {name} " in ran


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name):
    ended = gaitd(name, "--help")

    assert ended.returncode == 0, ended.stderr
    assert f"{name} [OPTIONS]" in ended.stdout


def test_an_unknown_command_is_a_matter_of_usage():
    ended = gaitd("dance")

    assert ended.returncode == 2
    assert "dance" in ended.stderr


def test_the_version_is_told():
    assert gaitd("--version").stdout.startswith("gaitd 0.")


@pytest.mark.parametrize("command", ["check", "core", "gateway"])
def test_a_configuration_error_is_one_line_and_exit_code_2_in_every_command(tmp_path, command):
    broken = tmp_path / "broken.toml"
    broken.write_text(
        (CONFIGS / "demo.toml").read_text().replace("period_ms = 10", "period_ms = 9")
    )

    ended = gaitd(command, "--config", str(broken))

    assert ended.returncode == 2
    assert ended.stderr == (f"configuration error: {broken}: cycle.period_ms = 9: one of 10\n")


@pytest.mark.parametrize("name", ["check", "core", "run"])
def test_a_bus_that_cannot_carry_the_frames_is_refused_before_it_is_opened(name, tmp_path):
    slow = Change("demo.toml", "bitrate_bit_per_s = 1_000_000", "bitrate_bit_per_s = 250_000")

    ended = gaitd(name, "--config", str(changed(copied(tmp_path), slow)))

    # The channel's server does not run: whoever had tried to open it would say so.
    assert ended.returncode == 2
    assert "bus.bitrate_bit_per_s" in ended.stderr
    assert "250000" in ended.stderr
    assert len(set(ended.stderr.splitlines())) == 1  # `run` may say it for core and gateway


def test_a_shell_completes_commands_and_their_options():
    def completed(line, word):
        environment = {
            **os.environ,
            "_GAITD_COMPLETE": "complete_bash",
            "COMP_WORDS": line,
            "COMP_CWORD": str(word),
        }
        program = [str(Path(sys.executable).with_name("gaitd"))]
        ended = subprocess.run(
            program, env=environment, capture_output=True, text=True, check=False
        )
        return ended.stdout.split()

    assert {"check", "core", "commission"} <= set(completed("gaitd c", 1))
    assert "--config" in completed("gaitd core --c", 2)
