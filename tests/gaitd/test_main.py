"""The command line as a whole: what there is, what it costs, how a configuration error ends."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from bench_bus import Machine
from command_line import gaitd
from config_files import CONFIGS, Change, changed, copied
from gaitd_client import wire
from gaitd_toml import ConfigError

from daemon.system.lock import hold
from gaitd.__main__ import COMMANDS, build, commands_for
from gaitd.command_line import failure, full_name

SAMPLE = CONFIGS.parent / "gaitd" / "sample.ring.xz"
EVERY = commands_for(None)
HEAVY = {"numba", "numpy", "scipy", "zenoh", "can", "canopen", "matplotlib", "plotext"}


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
    for name in EVERY:
        assert f" {name} " in ran


@pytest.mark.parametrize("name", EVERY)
def test_every_command_explains_itself(name):
    ended = gaitd(name, "--help")

    assert ended.code == 0, ended.err
    assert f"{name} [OPTIONS]" in ended.out


def test_a_schema_is_printed_by_name_and_an_unknown_one_is_refused(monkeypatch):
    assert "estimate" in gaitd("schema").out.split()
    assert json.loads(gaitd("schema", "estimate").out) == wire.schema(wire.Estimate)
    assert json.loads(gaitd("schema", "gaitd.stride.v1").out)["$id"] == "gaitd.stride.v1"
    assert (gaitd("schema", "strides").code, "one of" in gaitd("schema", "strides").err) == (
        2,
        True,
    )


def test_the_trainer_file_may_be_named_by_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("GAITD_CONFIG", str(tmp_path / "mine.toml"))

    for name in ("check", "status", "scan"):
        ended = gaitd(name)
        assert (ended.code, "mine.toml" in ended.err) == (2, True)


@pytest.mark.parametrize(
    ("package", "words"),
    [
        ("scipy", ("delay", "x.csv")),
        ("scipy", ("calibrate", "x.csv", "--robot", "x.toml", "--check")),
        ("matplotlib", ("strides",)),
    ],
)
def test_a_command_names_the_extra_that_it_needs(package, words):
    """A package that is None in `sys.modules` cannot be found."""
    program = (
        f"import sys; sys.modules[{package!r}] = None; from gaitd.__main__ import main; main()"
    )

    ended = subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, check=False
    )

    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith(f"gaitd {words[0]} needs {package}: pip install ")
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_for_a_command_of_gaitd_no_other_package_is_looked_for(monkeypatch, name):
    def read(**_selected):
        raise AssertionError("entry points were read")

    monkeypatch.setattr("gaitd.__main__.entry_points", read)

    assert gaitd(name, "--help").code == 0


@pytest.mark.parametrize("name", sorted(EVERY.keys() - COMMANDS))
def test_without_the_laboratory_each_of_its_commands_says_in_one_line_what_to_install(
    monkeypatch, name
):
    monkeypatch.setattr("gaitd.__main__.entry_points", lambda **_selected: ())

    ended = gaitd(name, "--json")

    assert ended.code == 2
    assert json.loads(ended.out)["blame"] == "gaitd-lab"
    assert ended.err == (
        f"gaitd has no command {name}; those of the laboratory are in gaitd-lab, which is not"
        " installed: pip install ./clients/python . ./gaitd_lab in a clone of gaitd\n"
    )


def test_an_unknown_command_is_a_matter_of_usage_and_the_version_is_told():
    ended = gaitd("dance")

    assert (ended.code, "dance" in ended.err) == (2, True)
    assert gaitd("--version").out.startswith("gaitd 0.")


def test_recordings_are_not_finished_in_a_folder_that_is_not_there(tmp_path):
    ended = gaitd("record", "--finish", "--output", tmp_path / "recodings")

    assert ended.code == 2
    assert "recodings: no such folder" in ended.err


@pytest.mark.parametrize("command", ["check", "core", "gateway"])
def test_each_configuration_error_is_one_line_and_exit_code_2_in_every_command(
    tmp_path, monkeypatch, command
):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # `core` sets it, for good
    monkeypatch.setattr("daemon.gateway.process.share_one_heap", lambda: None)
    broken = tmp_path / "broken.toml"
    broken.write_text(
        (CONFIGS / "demo.toml").read_text().replace("period_ms = 10", "period_ms = 9")
    )

    ended = gaitd(command, "--config", broken)

    assert ended.code == 2
    first, *others = ended.err.splitlines()
    assert first == f"configuration error: {broken}: cycle.period_ms = 9: one of 10"
    # Beside this file there are none of those that it names; the gateway needs none of them.
    assert all(": a file that exists; " in line for line in others)
    assert bool(others) == (command != "gateway")


def test_a_core_that_a_watchdog_watches_refuses_a_simulated_bus(tmp_path, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "1000000")
    ours = Change("demo.toml", '"/dev/shm/gaitd-demo"', f'"{tmp_path}/run"')

    ended = gaitd("core", "--config", changed(copied(tmp_path), ours))

    assert ended.code == 2
    assert 'demo.toml: bus.interface = "simulated": a real bus: a watchdog goes by' in ended.err
    assert "bus-simulated.conf" in ended.err
    assert ended.err.count("\n") == 1


def test_a_bus_that_cannot_carry_the_frames_is_refused_before_it_is_opened(tmp_path, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # `core` sets it, for good
    slow = Change("demo.toml", "bitrate_bit_per_s = 1_000_000", "bitrate_bit_per_s = 250_000")
    ours = Change("demo.toml", '"/dev/shm/gaitd-demo"', f'"{tmp_path}/run"')

    ended = gaitd("core", "--config", changed(copied(tmp_path), slow, ours))

    # The channel's server does not run: a core that had tried to open it would say so.
    assert ended.code == 2
    assert "bus.bitrate_bit_per_s" in ended.err
    assert "250000" in ended.err
    assert ended.err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--config", "FILE", "--channel", "can0"), "--channel"),
        (("--interface", "virtual", "--channel", "x", "--bitrate", "0"), "--bitrate"),
        (("--interface", "no-such", "--channel", "x", "--bitrate", "125000"), "no-such"),
        ((), "--interface = (missing)"),
    ],
)
def test_scan_told_wrongly_is_one_line_and_exit_code_2(tmp_path, words, said):
    config = Machine(tmp_path).config

    ended = gaitd("scan", *(config if word == "FILE" else word for word in words))

    assert ended.code == 2
    assert said in ended.err
    assert ended.err.count("\n") == 1


def test_a_bus_that_cannot_be_opened_is_a_matter_of_configuration(tmp_path):
    config = Machine(tmp_path).config
    gone = ('interface = "simulated"', 'interface = "socketcan"')
    config.write_text(config.read_text().replace(*gone))

    for words in (("scan",), ("drive", "right/hip", "dump")):
        ended = gaitd(*words, "--config", config)

        assert ended.code == 2
        assert "bus.channel" in ended.err
        assert ended.err.count("\n") == 1


@pytest.mark.parametrize(
    ("action", "option", "said"),
    [
        ("compare", ("--output", "x"), "--output"),
        ("dump", ("--eds",), "only for compare"),
        ("dump", ("--yes",), "only for store and restore"),
        ("store", ("--reset",), "only for restore"),
        ("store", ("--json",), "only for dump and compare"),
        ("compare", ("--eds", "--with", "x"), "not together"),
    ],
)
def test_an_option_of_another_action_is_refused(tmp_path, action, option, said):
    ended = gaitd("drive", "right/hip", action, *option, "--config", Machine(tmp_path).config)

    assert ended.code == 2
    assert said in ended.err


def test_bash_completes_with_the_script_that_is_installed():
    script = (
        'eval "$(_GAITD_COMPLETE=source_bash gaitd)"\n'
        "COMP_WORDS=(gaitd c); COMP_CWORD=1; _gaitd_completion gaitd\n"
        'echo "${COMPREPLY[@]}"\n'
    )
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"

    ended = subprocess.run(
        ["bash", "-c", script],
        **{"env": {**os.environ, "PATH": path}, "capture_output": True, "text": True},
        check=True,
    )

    assert {"check", "core", "commission"} <= set(ended.stdout.split())


ONE_LEG, TWO_LEGS = (f"--config {CONFIGS / name}" for name in ("demo.toml", "two_legs.toml"))


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("gaitd core --c", {"--config"}),
        ("gaitd mode h", {"hold", "hand_guiding"}),
        ("gaitd wait re", {"ready", "reference"}),
        ("gaitd explain hand", {"hand_switch_open", "hand_switch_unknown"}),
        ("gaitd reference ", {"right/hip", "right/slide", "hip", "slide"}),
        (
            f"gaitd reference {TWO_LEGS} ",
            {"right/hip", "right/slide", "left/hip", "left/slide"},
        ),
        (f"gaitd drive {TWO_LEGS} left/", {"left/hip", "left/slide"}),
        (f"gaitd mode excite {ONE_LEG} --scenario p", {"paper"}),
        ("gaitd mode excite --config none.toml --scenario p", set()),
        (f"gaitd watch {TWO_LEGS} left/e", {"left/estimate"}),
    ],
)
def test_a_shell_completes_words_of_gaitd_and_of_a_trainer(monkeypatch, line, found):
    words = line.split(" ")
    monkeypatch.setenv("_GAITD_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))

    assert set(gaitd().out.split()) == found


def test_a_name_without_its_beginning_is_taken_where_it_is_unique():
    known = ("right/hip", "right/slide", "left/hip")

    assert full_name("slide", known, "AXIS") == "right/slide"
    assert full_name("right/hip", known, "AXIS") == "right/hip"
    assert full_name("ip", known, "AXIS") == "ip"
    with pytest.raises(ConfigError, match='AXIS = "hip": one of right/hip, left/hip'):
        full_name("hip", known, "AXIS")


@pytest.mark.parametrize("words", [("drive", "hip", "dump"), ("sim", "inject", "silent", "hip")])
def test_an_axis_that_two_legs_have_names_both(words):
    ended = gaitd(*words, *TWO_LEGS.split())

    assert (ended.code, "one of right/hip, left/hip" in ended.err) == (2, True)


@pytest.mark.parametrize("name", EVERY)
def test_every_command_has_json_and_an_error_of_usage_is_a_document(name):
    leaf = typer.main.get_group(build(name)).commands[name]
    ended = gaitd(name, "--json", "--no-such-option")

    assert any("--json" in option.opts for option in leaf.params)
    assert ended.code == 2
    assert json.loads(ended.out) == {
        "error": "No such option: --no-such-option",
        "blame": "command line",
        "next": f"gaitd {name} --help",
        "exit_code": 2,
    }


@pytest.mark.parametrize(
    ("words", "code", "blame"),
    [
        (("check", "--config", "none.toml"), 2, "none.toml"),
        (("core", "--config", "none.toml"), 2, "none.toml"),
        (("gateway", "--config", "none.toml"), 2, "none.toml"),
        (("sim", "--config", "none.toml"), 2, "none.toml"),
        (("sim", "inject", "help", "--config", "none.toml"), 2, "none.toml"),
        (("scan", "--config", "none.toml"), 2, "none.toml"),
        (("drive", "right/hip", "dump", "--config", "none.toml"), 2, "none.toml"),
        (("keys", "list", "--config", "none.toml"), 2, "none.toml"),
        (("blackbox", "show", "none.ring"), 2, "none.ring"),
        (("blackbox", "list", "--recording", "x" * 300), 2, "x" * 300),
        (("replay", "none.csv"), 2, "none.csv"),
        (("delay", "none.csv"), 2, "none.csv"),
        (("baseline", "none.csv", "--robot", "none.toml", "--output", "x"), 2, "none.toml"),
        (("calibrate", "none.csv", "--robot", "none.toml"), 2, "none.toml"),
        (("demo", "--pace", "fast"), 2, "command line: --pace"),
        (("experiment", "--seconds", "1e6"), 2, "command line: --seconds"),
        (("ablation", "--config", "none.toml"), 2, "none.toml"),
        (("consistency", "--robot", "none.toml"), 2, "none.toml"),
        (("matrix", "--axis", "none"), 2, "command line"),
        (("schema", "none"), 2, "command line: NAME"),
        (("watch", "safety", "--endpoint", "tcp/127.0.0.1:9"), 4, "service"),
        (("status", "--endpoint", "tcp/127.0.0.1:9"), 4, "service"),
        (("stop", "--endpoint", "tcp/127.0.0.1:9"), 4, "service"),
    ],
)
def test_with_json_an_error_is_one_document_with_its_blame(tmp_path, words, code, blame):
    ended = gaitd(*words, "--json", folder=tmp_path)

    told = json.loads(ended.out)
    assert (ended.code, told["exit_code"]) == (code, code)
    assert told["error"]
    assert blame in told["blame"]
    # The next command names this trainer file, and no other placeholder.
    assert ("--config none.toml" in told["next"]) == (
        "--config" in words and not told["next"].endswith("--help")
    )
    assert "FILE" not in told["next"]


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (("check", "--config", CONFIGS / "demo.toml"), "verdict"),
        (("schema", "estimate"), "$id"),
        (("delay", SAMPLE), "robot"),
        (("replay", SAMPLE, "--output", "estimates.csv"), 0),
    ],
    ids=["check", "schema", "delay", "replay"],
)
def test_with_json_stdout_is_one_document_and_text_goes_to_stderr(tmp_path, words, key):
    ended = gaitd(*words, "--json", folder=tmp_path)

    told = json.loads(ended.out)
    assert told[key]


@pytest.mark.parametrize("words", [("--config=my files/none.toml",), ()])
def test_the_next_command_names_the_trainer_file_as_it_was_given(monkeypatch, tmp_path, words):
    if not words:
        monkeypatch.setenv("GAITD_CONFIG", "my files/none.toml")
    told = json.loads(gaitd("core", *words, "--json", folder=tmp_path).out)

    assert told["next"] == "gaitd check --config 'my files/none.toml'"


def test_an_error_that_check_cannot_see_names_another_command_or_none(monkeypatch, tmp_path):
    config = CONFIGS / "demo.toml"
    without_keys = json.loads(gaitd("keys", "apply", "--config", config, "--json").out)
    monkeypatch.setattr("sys.argv", ["gaitd", "core", "--config", str(config)])
    with (
        pytest.raises(ConfigError) as refused,
        hold(config, "paths.state", tmp_path, "core"),
        hold(config, "paths.state", tmp_path, "core"),
    ):
        pass

    assert (without_keys["blame"], without_keys["next"]) == (f"{config}: zenoh.keys", "")
    assert failure(refused.value, "core")["next"] == f"gaitd status --config {config}"
