"""`gaitd sim` as a process: exit codes, its socket, its truth, and a client that is killed."""

import shutil
import socket
from functools import partial

import can
import pytest
from command_line import gaitd
from config_files import CONFIGS
from processes import Service


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


def test_it_serves_its_bus_until_sigterm_and_writes_the_truth_of_every_sync(tmp_path):
    with Service(tmp_path) as service:
        process = service.start("sim", *service.output_arguments, "--seed", "3")
        service.wait(lambda: process.output().endswith("/bus, in simulated time\n"), 60)
        with service.listener() as bus:
            for _ in range(5):
                bus.send(can.Message(arbitration_id=0x080, is_extended_id=False))
                traffic = bus.recv(0.05)  # boot-up messages, and no TPDO
                assert traffic is None or traffic.arbitration_id in (0x705, 0x706)
        lines = ("help", "patient unknown", "silent right/hip 0.1")
        answers = [service.inject(line) for line in lines]
        addressed = ("--config", service.config)
        commands = [
            gaitd("sim", "patient", "active", *addressed),
            gaitd("sim", "inject", "silent", "right/hip", 0.1, *addressed),
            gaitd("sim", "inject", "help", "--control", service.control_path, *addressed),
            gaitd("sim", "patient", "unknown", *addressed),
            gaitd("sim", "inject", "nonsense", "--control", service.control_path, *addressed),
        ]
        assert process.end() == 0

    assert "encoder_glitch:" in answers[0] and "patient PROGRAMME" in answers[0]
    assert answers[1].startswith("error: ")
    assert answers[2] == "ok: began silent on right/hip"
    assert [one.code for one in commands] == [0, 0, 0, 1, 1]
    assert commands[0].out == "patient programme is active\n"
    assert commands[1].out == "began silent on right/hip\n"
    assert "encoder_glitch:" in commands[2].out
    assert all("error: " in one.err and not one.out for one in commands[3:])
    rows = service.truth()
    assert rows[-1]["sync_count"] == "5"
    assert {"time_s", "hip_angle_rad", "slide_patient_n"} <= set(rows[0])
    assert not service.control_path.exists()


def test_on_request_the_truth_goes_on_while_no_sync_comes_with_the_count_of_the_last_one(
    tmp_path,
):
    with Service(tmp_path) as service:
        service.start_drives()
        with service.listener() as bus:
            bus.send(can.Message(arbitration_id=0x080, is_extended_id=False))
            while sum(row["sync_count"] == "1" for row in service.truth()) < 5:
                bus.recv(0.02)
        assert service.parts["sim"].end() == 0

    rows = service.truth()
    counts = [int(row["sync_count"]) for row in rows]
    times = [int(row["sync_mono_ns"]) for row in rows]
    assert set(counts) <= {0, 1}
    assert counts == sorted(counts)
    assert counts.count(1) >= 5
    assert times == sorted(times)  # a SYNC may come at the instant of a row in silence


def test_a_command_to_virtual_drives_that_do_not_run_is_exit_code_4(configs):
    for more in ((), ("--control", configs / "nowhere")):
        ended = gaitd("sim", "inject", "help", "--config", configs / "demo.toml", *more)

        assert (ended.code, ended.out) == (4, "")
        assert "not answer" in ended.err


def test_a_line_is_for_inject_and_patient_only(refused):
    assert 'LINE = "silent"' in refused("run", "silent")


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
        ("plant.toml", '"epos4"\nnode_id = 5', '"elmo_gold"\nnode_id = 5', "right.hip.personality"),
        ("plant.toml", "rise_s = 0.06", "rise_s = nan", "patient.programme[5].effort[0].rise_s"),
        ("plant.toml", "jitter_us = 30.0", "jitter_us = -0.0", "sensor.latch_jitter_us = -0.0"),
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
