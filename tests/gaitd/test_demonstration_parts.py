import itertools
import math
import os
import signal
import socket
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

from daemon.config.shipped import configs_folder
from gaitd_lab.demonstration import engineer, stage
from gaitd_lab.demonstration.evaluation import Row, Span, evaluate, pairs
from gaitd_lab.demonstration.feed import RECEIVED, TRUE, Track, TruthTail
from gaitd_lab.demonstration.picture import Results, draw
from gaitd_lab.demonstration.script import Kind
from gaitd_lab.demonstration.stage import Stage, StageTime, Tempo
from gaitd_lab.processes import ManagedProcess, ServiceError
from sim_drives.plant.truth import TruthRow

CONFIGS = Path(__file__).parents[2] / "configs"
CYCLE_NS = 10_000_000


def tracks(count=400, *, error_nm=0.0, error_n=0.0, rest=()):
    """An estimate that is the truth but for a constant, and null at some rows."""
    traffic, true = Track(RECEIVED), Track(TRUE)
    for row in range(count):
        time_ns = 1_000_000_000 + row * CYCLE_NS
        hip, slide = 8 * math.sin(row / 40), 40 * math.cos(row / 40)
        true.add(time_ns + 700_000, (hip, slide, 6.0, 65.0))
        values = dict.fromkeys(RECEIVED, 0.0) | {
            "hip_patient_nm": hip + error_nm,
            "slide_patient_n": slide + error_n,
        }
        if row in rest:
            values |= {"hip_patient_nm": math.nan, "slide_patient_n": math.nan}
        traffic.add(time_ns, tuple(values[name] for name in RECEIVED))
    return traffic, true


def rows(kind, **changes) -> tuple[Row, ...]:
    span = Span("a span", kind, 0, 10**12)
    return evaluate([span], pairs(*tracks(**changes)))


def test_an_estimate_within_its_bounds_passes():
    assert all(row.passed for row in rows(Kind.ACTIVE, error_nm=0.5, error_n=2.9))


@pytest.mark.parametrize(
    ("axis", "errors"), [("hip", {"error_nm": 0.7}), ("slide", {"error_n": 3.1})]
)
def test_an_axis_out_of_its_bound_fails_alone(axis, errors):
    assert {row.axis for row in rows(Kind.ACTIVE, **errors) if not row.passed} == {axis}


def test_the_passive_bounds_are_the_tighter_ones():
    assert all(row.passed for row in rows(Kind.ACTIVE, error_nm=0.4))
    assert not all(row.passed for row in rows(Kind.PASSIVE, error_nm=0.4))


def test_an_estimate_that_is_hardly_ever_valid_fails_however_good_it_is():
    assert not any(row.passed for row in rows(Kind.ACTIVE, rest=range(200)))


def test_nothing_to_judge_is_a_failure():
    judged = evaluate([Span("before", Kind.ACTIVE, 0, 1)], pairs(*tracks()))

    assert not any(row.passed for row in judged)
    assert not Results(pairs(*tracks()), [], [], [], "").passed


def test_an_artificial_disturbance_is_what_the_estimate_should_show():
    traffic, true = Track(RECEIVED), Track(TRUE)
    true.add(0, (0.0, 0.0, 0.0, 0.0))
    values = dict.fromkeys(RECEIVED, 0.0) | {"hip_patient_nm": 4.0, "artificial_hip_nm": 4.0}
    traffic.add(0, tuple(values[name] for name in RECEIVED))

    hip, slide = pairs(traffic, true)

    assert hip.wanted.tolist() == [4.0]
    assert slide.wanted.tolist() == [0.0]


def test_an_estimate_without_a_truth_of_its_cycle_is_not_judged():
    traffic, true = Track(RECEIVED), Track(TRUE)
    true.add(0, (0.0, 0.0, 0.0, 0.0))
    traffic.add(6_000_000, tuple(0.0 for _ in RECEIVED))

    assert np.isnan(pairs(traffic, true)[0].wanted).all()


def test_the_truth_is_followed_by_whole_lines(tmp_path):
    track = Track(TRUE)
    tail = TruthTail(tmp_path / "truth.csv", track)
    tail.read()
    assert len(track) == 0

    cells = dict.fromkeys(TruthRow._fields, "0") | {"hip_patient_nm": "8.5"}
    line = ",".join((cells | {"sync_mono_ns": "123"}).values())
    with (tmp_path / "truth.csv").open("w") as file:
        file.write(",".join(TruthRow._fields) + "\n" + line[:10])
        file.flush()
        tail.read()
        assert len(track) == 0
        file.write(line[10:] + "\n")
        file.flush()
        tail.read()
    tail.close()

    times, values = track.arrays()
    assert times.tolist() == [123]
    assert track.column("hip_patient_nm", values).tolist() == [8.5]


@pytest.mark.parametrize("empty", [False, True])
def test_an_act_has_a_configuration_of_its_own_that_checks_out(tmp_path, empty):
    from daemon.preflight.load import load
    from gaitd_lab.virtual_machine import load_plant

    act = Stage(tmp_path, CONFIGS, empty=empty, tempo=Tempo(), begin_ns=0)
    act.end()

    settings = load(act.config)
    assert settings.file.trainer.zenoh.listen == act.target.endpoints
    assert settings.file.runtime == tmp_path / "run"
    assert (settings.robot.patient is None) == empty
    assert load_plant(settings.file)[1].robot == settings.file.robot.name
    here = tomllib.loads((CONFIGS / "demo.toml").read_text())
    assert settings.file.trainer.bus.channel != here["bus"]["channel"]


def test_the_springs_of_the_empty_machine_carry_it_where_it_starts(tmp_path):
    from daemon.config.robot import leg_parameters
    from daemon.preflight.load import load
    from observer.mechanism.mechanism import gravity

    act = Stage(tmp_path, CONFIGS, empty=True, tempo=Tempo(), begin_ns=0)
    act.end()
    start = tomllib.loads((act.config.parent / "plant.toml").read_text())["start"]

    pose = np.array((math.radians(start["hip_deg"]), start["slide_m"]))
    load_there = gravity(leg_parameters(load(act.config).robot), pose)

    assert np.abs(load_there) == pytest.approx([0.0, 0.0], abs=1e-3)


def test_a_core_that_does_not_come_ends_the_demonstration(tmp_path, monkeypatch):
    monkeypatch.setattr(stage, "READY_WITHIN_S", 0.0)
    passing = StageTime(tmp_path / "bus", 0, Tempo())

    with pytest.raises(ServiceError, match="core and gateway are not there"):
        passing.turn(gateway_is_there=False)


def test_a_process_that_dies_is_reported_with_its_last_words(tmp_path):
    process = ManagedProcess("the dancer", ["-m", "gaitd", "dance"], tmp_path / "log")
    process.wait(30)

    with pytest.raises(ServiceError, match=r"(?s)the dancer ended with 2.*dance"):
        process.check()
    process.end()


def test_a_process_ends_when_the_one_that_started_it_is_killed(tmp_path):
    script = (
        "import sys, time; from pathlib import Path\n"
        "from gaitd_lab.processes import ManagedProcess\n"
        f"config = {str(CONFIGS / 'demo.toml')!r}\n"
        f"log = Path({str(tmp_path)!r}) / 'log'\n"
        "one = ManagedProcess('sim', ['-m', 'gaitd', 'sim', '--config', config], log)\n"
        "print(one.pid, flush=True); time.sleep(60)"
    )
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()

    deadline = time.monotonic() + 60
    while _lives(child) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not _lives(child)


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return False
    return state != "Z"


def test_the_picture_is_drawn_also_of_a_demonstration_that_failed(tmp_path):
    spans = [Span("gait", Kind.ACTIVE, 1_000_000_000, 4_000_000_000)]
    both = pairs(*tracks(rest=range(50, 90)))

    draw(Results(both, spans, evaluate(spans, both), [], "stopped"), tmp_path / "a.png")
    draw(Results(pairs(Track(RECEIVED), Track(TRUE)), [], [], [], "early"), tmp_path / "b.png")

    for name in ("a.png", "b.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_the_configurations_are_found_beside_the_code():
    assert configs_folder("--config", "demo.toml") == CONFIGS


# --- the engineer's page --------------------------------------------------------------------------


def test_the_engineers_page_takes_the_next_free_port():
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        page = engineer.find_engineer_page(port)

    assert page.port is not None
    assert page.port > port
    assert page.said == f"the engineer's page: http://127.0.0.1:{page.port}/"


def test_without_a_free_port_or_its_package_there_is_a_sentence_and_no_page(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        monkeypatch.setattr(engineer, "PORTS_TRIED", 1)
        page = engineer.find_engineer_page(port)
    assert (page.port, page.address) == (None, "")
    assert page.said == f"no engineer's page: ports {port} to {port} are in use"

    monkeypatch.setattr(engineer, "PACKAGE", "gaitd_of_no_display")
    page = engineer.find_engineer_page(port)
    assert page.port is None
    assert "`make demo`" in page.said


class Steps:
    def __init__(self, *steps_ns):
        self._times_ns = itertools.accumulate(steps_ns)

    def now_ns(self):
        return next(self._times_ns)


def test_its_clock_is_as_slow_as_the_slower_of_two():
    act = Steps(1000, 5, 0, 50)
    clock = engineer.SlowerClock(act, Steps(7, 10, 10, 10))

    assert [clock.now_ns() for _ in range(3)] == [5, 5, 15]
