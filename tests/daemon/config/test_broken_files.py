"""A broken configuration is refused by file, key, value and what would be allowed.

Each row of broken_files.tsv is one small change of the good files and the four things that the one
line on stderr must then say; `told of` is the file that it names, where it is another one.
"""

import socket
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import pytest
from config_files import CONFIGS, Change, changed, copied

from daemon.preflight.load import ConfigError, load
from daemon.system.lock import hold
from gaitd.__main__ import main


class Broken(NamedTuple):
    name: str
    change: Change
    file: str
    key: str
    value: str
    allowed: str


def broken(line: str) -> Broken:
    """A row of the table, in which a new line is \\n."""
    name, file, old, new, told_of, *told = line.replace("\\n", "\n").split("\t")
    return Broken(name, Change(file, old, new), told_of or file, *told)


TABLE = Path(__file__).with_name("broken_files.tsv").read_text(encoding="utf-8")
BROKEN = [broken(line) for line in TABLE.splitlines()[1:]]


@pytest.mark.parametrize("row", BROKEN, ids=[row.name for row in BROKEN])
def test_a_broken_configuration_is_refused_by_file_key_value_and_allowed(tmp_path, row):
    demo = changed(copied(tmp_path), row.change)

    with pytest.raises(ConfigError) as refused:
        load(demo)

    line = refused.value.lines
    assert line.startswith(f"configuration error: {demo.parent / row.file}: {row.key} = ")
    assert row.value in refused.value.value
    assert row.allowed in refused.value.allowed
    assert line.count("\n") == len(refused.value.more)


def test_a_gait_near_the_singularity_is_refused(tmp_path):
    demo = changed(
        copied(tmp_path),
        Change("limits.toml", "soft_ratio = 0.3", "soft_ratio = 0.65"),
        Change("limits.toml", "position_max_m = 0.95", "position_max_m = 0.933"),
        Change("limits.toml", "soft_margin_m = 0.015", "soft_margin_m = 0.001"),
    )

    with pytest.raises(ConfigError) as refused:
        load(demo)

    assert refused.value.file == str(demo)
    assert refused.value.key == "gait.knee.harmonics_deg"
    assert refused.value.value == "(|sin| of shank and shoe 0.640)"
    assert refused.value.allowed == ">= singularity.soft_ratio = 0.65"


@pytest.mark.parametrize(
    ("old", "new", "key", "allowed"),
    [
        (
            'state = "../out/demo/state"',
            'state = "/dev/shm/gaitd-demo/state"',
            "paths.state",
            "outside",
        ),
        (
            'runtime = "/dev/shm/gaitd-demo"',
            'runtime = "demo.toml"',
            "paths.runtime",
            "a directory",
        ),
        (
            'runtime = "/dev/shm/gaitd-demo"',
            f'runtime = "../{"long" * 30}"',
            "paths.runtime",
            "bytes, because it holds the sockets of core and gateway",
        ),
    ],
)
def test_a_directory_that_cannot_work_is_refused(tmp_path, old, new, key, allowed):
    demo = changed(copied(tmp_path), Change("demo.toml", old, new))

    with pytest.raises(ConfigError) as refused:
        load(demo)

    assert (refused.value.file, refused.value.key) == (str(demo), key)
    assert allowed in refused.value.allowed


def test_a_trainer_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.toml: no such file or directory"):
        load(tmp_path / "nowhere.toml")


def test_a_file_that_is_not_text_is_named_with_its_line(tmp_path):
    demo = copied(tmp_path) / "demo.toml"
    demo.write_bytes(b'robot = "robot.toml"\nlimits = "\xff"\n')

    with pytest.raises(ConfigError, match=r"demo\.toml: line 2 = \(not UTF-8\): .*UTF-8"):
        load(demo)


REFUSED = {
    "a drive that its EDS denies": Change(
        "drives/hip_epos4.toml", 'eds = "epos4.eds"', 'eds = "generic402.eds"'
    ),
    "an EDS that is none": Change(
        "drives/hip_epos4.toml", 'eds = "epos4.eds"', 'eds = "hip_epos4.toml"'
    ),
    "a dead core that runs too far": Change(
        "limits.toml", "max_runaway_deg = 70.0", "max_runaway_deg = 50.0"
    ),
    "an endpoint that other machines can reach": Change(
        "demo.toml", "tcp/127.0.0.1:7447", "tcp/192.168.1.5:7447"
    ),
    **{row.name: row.change for row in (BROKEN[0], BROKEN[-1])},
}
"""Files that only the judgement of what is swept refuses, and two that cannot be loaded."""


def ended(monkeypatch, capfd, *words: str) -> tuple[int, str]:
    """How a command line ends, in this process: its exit code and what it says on stderr."""
    monkeypatch.setattr(sys, "argv", ["gaitd", *words])
    with pytest.raises(SystemExit) as end:
        main()
    return int(end.value.code or 0), capfd.readouterr().err


@pytest.fixture
def started(monkeypatch) -> list[object]:
    """The settings that a core would have been started with."""
    settings: list[object] = []

    def run_core(*arguments: object, **_: object) -> int:
        settings.append(arguments[0])
        return 0

    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setenv("JOURNAL_STREAM", "")
    monkeypatch.setattr("daemon.core.runtime.process.run_core", run_core)
    monkeypatch.setattr("daemon.ipc.starting.said", lambda _: nullcontext(lambda: None))
    monkeypatch.setattr("daemon.system.lock.hold", lambda *_: nullcontext())
    return settings


@pytest.mark.parametrize("name", REFUSED)
def test_the_core_refuses_what_check_refuses_with_the_same_text(
    tmp_path, monkeypatch, capfd, started, name
):
    demo = str(changed(copied(tmp_path), REFUSED[name]))

    checked = ended(monkeypatch, capfd, "check", "--config", demo)
    core = ended(monkeypatch, capfd, "core", "--config", demo)

    assert core == checked
    assert core[0] == 2
    assert all(line.startswith("configuration error: ") for line in core[1].splitlines())
    assert not started


@pytest.mark.parametrize("trainer", ["demo", "trainer", "two_legs", "vcan"])
def test_the_core_starts_with_every_shipped_configuration(monkeypatch, capfd, started, trainer):
    config = str(CONFIGS / f"{trainer}.toml")

    assert ended(monkeypatch, capfd, "check", "--config", config) == (0, "")
    assert ended(monkeypatch, capfd, "core", "--config", config) == (0, "")
    assert len(started) == 1


@pytest.mark.parametrize(("name", "key"), [("run", "paths.runtime"), ("state", "paths.state")])
def test_a_directory_that_another_core_holds_is_refused_before_the_files_are_checked(
    tmp_path, monkeypatch, capfd, name, key
):
    demo = changed(
        copied(tmp_path),
        Change("demo.toml", '"/dev/shm/gaitd-demo"', f'"{tmp_path}/run"'),
        Change("demo.toml", '"../out/demo/state"', f'"{tmp_path}/state"'),
    )
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setattr("daemon.preflight.acceptance.accepted", lambda _: pytest.fail("checked"))

    with hold(demo, key, tmp_path / name, "core"):
        code, said = ended(monkeypatch, capfd, "core", "--config", str(demo))

    assert (code, f"{key} = " in said, "a gaitd core with pid" in said) == (2, True, True)


def run_of(tmp_path, endpoint, *changes):
    """`gaitd run` of the demonstration's files with these changes, until it ends by itself."""
    with TemporaryDirectory(dir="/dev/shm") as folder:  # the sockets' path must be short
        demo = changed(
            copied(tmp_path),
            *changes,
            Change("demo.toml", '"/dev/shm/gaitd-demo"', f'"{folder}/run"'),
            Change("demo.toml", '"../out/demo/state"', f'"{tmp_path}/state"'),
            Change("demo.toml", "tcp/127.0.0.1:7447", endpoint or f"unixsock-stream/{folder}/z"),
        )
        run = subprocess.run(
            [sys.executable, "-m", "gaitd", "run", "--config", str(demo)],
            capture_output=True,
            text=True,
            check=False,
        )
        return demo, run


def test_run_ends_with_the_refusal_of_its_core(tmp_path):
    demo, run = run_of(tmp_path, "", REFUSED["an EDS that is none"])

    assert run.returncode == 2
    starting, refused = run.stderr.splitlines()
    assert starting.startswith("gaitd: starting")
    assert refused.startswith(f"configuration error: {demo.parent / 'drives/hip_epos4.toml'}: eds")


def test_run_ends_with_a_configuration_error_where_another_program_has_the_port(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        _, run = run_of(tmp_path, endpoint)

    assert run.returncode == 2
    assert f"gaitd gateway: cannot listen on {endpoint}" in run.stderr
