"""`gaitd sim` as a process: exit codes, its socket, its truth, and a client that is killed."""

import contextlib
import csv
import shutil
import signal
import socket
import subprocess
import sys
from functools import partial

import can
import pytest
from command_line import gaitd
from config_files import CONFIGS


@pytest.fixture
def configs(tmp_path):
    """The demo's configuration with a bus of its own."""
    folder = tmp_path / "configs"
    shutil.copytree(CONFIGS, folder)
    change(folder / "demo.toml", "/dev/shm/gaitd-demo.bus", "bus")
    return folder


def change(path, old, new):
    text = path.read_text()
    assert text.count(old) == 1, (path, old)
    path.write_text(text.replace(old, new))


def arguments(configs, *more):
    return [sys.executable, "-m", "gaitd", "sim", "--config", str(configs / "demo.toml"), *more]


@contextlib.contextmanager
def running(command):
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def sim(configs, monkeypatch):
    """Runs it in this process, of which it must change nothing that lasts."""
    for name in ("os.sched_setscheduler", "signal.signal", "gc.freeze", "sys.setswitchinterval"):
        monkeypatch.setattr(name, lambda *_: None)
    return partial(gaitd, "sim", "--config", configs / "demo.toml")


@pytest.fixture
def refused(sim):
    """The one line of a command line that does not get as far as to run."""

    def line(*more):
        ended = sim(*more)
        assert ended.code == 2, ended.err
        assert ended.err.count("\n") == 1, ended.err
        return ended.err

    return line


def test_it_serves_its_bus_until_sigterm_and_writes_the_truth_of_every_sync(configs, tmp_path):
    truth, control = tmp_path / "truth.csv", tmp_path / "control"
    command = arguments(configs, "--truth", str(truth), "--control", str(control), "--seed", "3")
    with running(command) as process:
        assert process.stdout.readline().endswith("configs/bus, in simulated time\n")
        with can.Bus(interface="gaitd", channel=str(configs / "bus")) as bus:
            for _ in range(5):
                bus.send(can.Message(arbitration_id=0x080, is_extended_id=False))
                heard = bus.recv(0.05)  # boot-up messages, and no TPDO
                assert heard is None or heard.arbitration_id in (0x705, 0x706)
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.bind(str(tmp_path / "sender"))
            sender.settimeout(5)
            answers = []
            for line in ("help", "patient nobody", "silent right/hip 0.1"):
                sender.sendto(line.encode(), str(control))
                answers.append(sender.recv(8192).decode())
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0

    assert "encoder_glitch:" in answers[0] and "patient PROGRAMME" in answers[0]
    assert answers[1].startswith("error: ")
    assert answers[2] == "ok: began silent on right/hip"
    rows = list(csv.DictReader(truth.open()))
    assert rows[-1]["sync_count"] == "5"
    assert {"time_s", "hip_angle_rad", "slide_patient_n"} <= set(rows[0])
    assert not control.exists()


def test_on_request_the_truth_goes_on_while_no_sync_comes_with_the_count_of_the_last_one(
    configs, tmp_path
):
    truth = tmp_path / "truth.csv"
    command = arguments(configs, "--truth", str(truth), "--truth-in-silence")
    with running(command) as process:
        assert process.stdout.readline().endswith("configs/bus, in simulated time\n")
        with can.Bus(interface="gaitd", channel=str(configs / "bus")) as bus:
            bus.send(can.Message(arbitration_id=0x080, is_extended_id=False))
            while sum(row["sync_count"] == "1" for row in csv.DictReader(truth.open())) < 5:
                bus.recv(0.02)
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0

    rows = list(csv.DictReader(truth.open()))
    counts = [int(row["sync_count"]) for row in rows]
    times = [int(row["sync_mono_ns"]) for row in rows]
    assert set(counts) <= {0, 1}
    assert counts == sorted(counts)
    assert counts.count(1) >= 5
    assert times == sorted(times)  # a SYNC may come at the instant of a row in silence


def test_it_ends_by_itself_after_its_duration(sim):
    assert sim("--duration", 0.1).code == 0


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("demo.toml", 'sim = "plant.toml"\n', "", "sim = (missing)"),
        ("demo.toml", 'sim = "plant.toml"', 'sim = "plans.toml"', "plans.toml"),
        ("plant.toml", "lead_m = 0.15", "", "drives.right.slide"),
        ("plant.toml", "node_id = 6", "node_id = 5", "drives.right.slide.node_id = 5"),
        ("plant.toml", "node_id = 6", "node_id = 128", "drives.right.slide.node_id = 128"),
        ("plant.toml", "gear_ratio = 6.0", "gear_ratio = -6.0", "drives.right.slide.gear_ratio"),
    ],
)
def test_a_wrong_configuration_is_one_line_and_exit_code_2(configs, refused, file, old, new, said):
    change(configs / file, old, new)

    assert said in refused()


def test_an_eds_that_is_none_is_named(configs, refused):
    (configs / "drives/epos4.eds").write_text("this is no EDS\n")

    assert "drives.right.hip.eds" in refused()


def test_a_bus_that_another_one_serves_is_named(refused, configs):
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as taken:
        taken.bind(str(configs / "bus"))
        taken.listen()
        said = refused()

    assert "bus.channel" in said
    assert "another `gaitd sim` serves this bus" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--pace", "fast"), "a pace is max, or 0.01 to 1000; not 'fast'"),
        (("--pace", "2", "--wall-clock"), "only in simulated time"),
        (("--no-drives", "--truth", "x.csv"), "nothing with --no-drives"),
        (("--no-drives", "--without", "right/hip"), "nothing with --no-drives"),
        (("--without", "left/hip"), "one of right/hip, right/slide"),
    ],
)
def test_options_that_do_not_go_together_are_refused(refused, words, said):
    assert said in refused(*words)


def test_a_truth_file_that_cannot_be_written_is_named(refused, tmp_path):
    assert "--truth" in refused("--truth", tmp_path / "nowhere" / "truth.csv")


def test_a_control_socket_that_cannot_be_made_is_named(refused, tmp_path):
    assert "--control" in refused("--control", tmp_path / "nowhere" / "socket")
