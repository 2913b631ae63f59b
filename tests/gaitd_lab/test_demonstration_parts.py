import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from gaitd_session.store import (
    BlockRow,
    EndRow,
    GoalRow,
    InterruptionRow,
    SessionRow,
    Store,
    StrideRow,
)

from daemon.config.shipped import configs_folder
from gaitd_lab.demonstration import client_process, clients, stage, training, turns
from gaitd_lab.demonstration.evaluation import Results, Row, Span, evaluate, pairs
from gaitd_lab.demonstration.feed import RECEIVED, TRUE, LegTracks, Track, TruthTail
from gaitd_lab.demonstration.picture import draw
from gaitd_lab.demonstration.script import Kind
from gaitd_lab.demonstration.stage import ActTime, Stage, empty_edits
from gaitd_lab.processes import ManagedProcess, ServiceError, Tempo
from sim_drives.plant.truth import TruthRow
from simtime.link import LinkLostError

CONFIGS = Path(__file__).parents[2] / "configs"
DEMO, TWO_LEGS = CONFIGS / "demo.toml", CONFIGS / "two_legs.toml"
CYCLE_NS = 10_000_000
TURN_NS = 30_000_000


def tracks(count=400, *, error_nm=0.0, error_n=0.0, rest=()):
    """An estimate that is the truth but for a constant, and null at some rows."""
    traffic, true = made = LegTracks.new()
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
    return {"right": made}


def rows(kind, **changes) -> tuple[Row, ...]:
    span = Span("a span", kind, 0, 10**12)
    return evaluate([span], pairs(tracks(**changes)))


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
    judged = evaluate([Span("before", Kind.ACTIVE, 0, 1)], pairs(tracks()))

    assert not any(row.passed for row in judged)
    assert not Results(pairs(tracks()), [], [], [], "").passed


def test_each_axis_of_two_legs_is_judged_and_bears_the_name_of_its_leg():
    legs = {"right": tracks()["right"], "left": tracks(error_nm=0.7)["right"]}
    judged = evaluate([Span("a span", Kind.ACTIVE, 0, 10**12)], pairs(legs))

    assert [(row.axis, row.passed) for row in judged] == [
        *(("right hip", True), ("right slide", True)),
        *(("left hip", False), ("left slide", True)),
    ]


def test_an_artificial_disturbance_is_what_the_estimate_should_show():
    traffic, true = made = LegTracks.new()
    true.add(0, (0.0, 0.0, 0.0, 0.0))
    values = dict.fromkeys(RECEIVED, 0.0) | {"hip_patient_nm": 4.0, "artificial_hip_nm": 4.0}
    traffic.add(0, tuple(values[name] for name in RECEIVED))

    hip, slide = pairs({"right": made})["right"]

    assert hip.wanted.tolist() == [4.0]
    assert slide.wanted.tolist() == [0.0]


def test_an_estimate_without_a_truth_of_its_cycle_is_not_judged():
    traffic, true = made = LegTracks.new()
    true.add(0, (0.0, 0.0, 0.0, 0.0))
    traffic.add(6_000_000, tuple(0.0 for _ in RECEIVED))

    assert np.isnan(pairs({"right": made})["right"][0].wanted).all()


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


def act_files(folder, edits, roles, trainer=DEMO):
    """Files of an act, which is not started."""
    act = Stage(folder, trainer, edits, roles, tempo=Tempo(), begin_ns=0)
    act.end()
    return act


@pytest.mark.parametrize(
    ("trainer", "edits", "roles"),
    [
        (DEMO, {}, {}),
        (DEMO, empty_edits(DEMO), {}),
        (DEMO, training.EDITS, training.ROLES),
        (TWO_LEGS, empty_edits(TWO_LEGS), {}),
    ],
    ids=["patient", "empty", "training", "two_legs"],
)
def test_an_act_has_a_configuration_of_its_own_that_checks_out(tmp_path, trainer, edits, roles):
    from daemon.preflight.load import load
    from gaitd_lab.virtual_machine import load_plant

    act = act_files(tmp_path, edits, roles, trainer)

    settings = load(act.config)
    assert settings.file.trainer.zenoh.listen == act.target.endpoints
    assert settings.file.runtime == tmp_path / "run"
    assert (settings.robot.patient is None) == ("robot_empty.toml" in edits)
    assert (settings.file.keys is not None) == bool(roles)
    assert load_plant(settings.file)[1].robot == settings.file.robot.name
    here = tomllib.loads(trainer.read_text())
    assert settings.file.trainer.bus.channel != here["bus"]["channel"]


def test_the_springs_of_the_empty_machine_carry_it_where_it_starts(tmp_path):
    from daemon.config.robot import leg_parameters
    from daemon.preflight.load import load
    from observer.mechanism.mechanism import gravity

    act = act_files(tmp_path, empty_edits(DEMO), {})
    start = tomllib.loads((act.config.parent / "plant.toml").read_text())["start"]

    pose = np.array((math.radians(start["hip"]["position_deg"]), start["slide"]["position_m"]))
    load_there = gravity(leg_parameters(load(act.config).robot), pose)

    assert np.abs(load_there) == pytest.approx([0.0, 0.0], abs=1e-3)


def test_a_core_that_does_not_come_ends_the_demonstration(tmp_path, monkeypatch):
    monkeypatch.setattr(stage, "READY_WITHIN_S", 0.0)
    passing = ActTime(tmp_path / "bus", 0, Tempo())

    with pytest.raises(ServiceError, match="core and gateway are not there"):
        passing.turn(lambda: None, lambda: None, gateway_is_there=False)
    passing.close()


def test_the_view_is_drawn_while_time_passes(tmp_path, monkeypatch):
    drawn, ended = threading.Event(), []
    monkeypatch.setattr(stage.time, "sleep", lambda _: ended.append(drawn.wait(10)))
    passing = ActTime(tmp_path / "bus", 0, Tempo())

    passing.turn(drawn.set, lambda: None, gateway_is_there=False)

    assert ended == [True], "drawn before the turn has ended"
    passing.close()


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
    legs = pairs(tracks(rest=range(50, 90)))

    draw(Results(legs, spans, evaluate(spans, legs), [], "stopped"), tmp_path / "a.png")
    draw(Results(pairs({"right": LegTracks.new()}), [], [], [], "early"), tmp_path / "b.png")
    draw(Results({}, [], [], [], "early"), tmp_path / "c.png")

    for name in ("a.png", "b.png", "c.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_the_configurations_are_found_beside_the_code():
    assert configs_folder("--config", "demo.toml") == CONFIGS


# --- pages ----------------------------------------------------------------------------------------


def test_a_page_takes_the_next_free_port():
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        page = clients.find_page("engineer", port)

    assert page.port is not None
    assert page.port > port
    assert page.said == f"the engineer's page: http://127.0.0.1:{page.port}/"


def test_a_page_has_a_port_where_those_that_it_tries_are_in_use(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        monkeypatch.setattr(clients, "PORTS_TRIED", 1)
        page = clients.find_page("patient", port)

    assert page.port not in {None, port}
    assert page.shown == f"in a browser: http://127.0.0.1:{page.port}/"


def test_without_its_package_there_is_a_sentence_and_no_page(monkeypatch):
    monkeypatch.setattr(clients, "DISPLAY", "gaitd_of_no_display")
    page = clients.find_page("engineer", 8090)

    assert (page.port, page.shown) == (None, "")
    assert "`make demo`" in page.said


class Link:
    """Time of a seat, which passes while it waits."""

    def __init__(self):
        self.ns = 0

    def open(self):
        pass

    def wait(self, until_ns, *, for_frame):
        assert not for_frame
        self.ns = until_ns

    def take(self):
        return []

    def now_ns(self):
        return self.ns


@pytest.mark.parametrize("ages_ms", [(200, 40, 21, 20, 0), (0, 0), (None, 0)])
def test_time_waits_for_the_messages_that_were_not_received(ages_ms):
    """Messages of 20 ms ago are complete; without any there is nothing to wait for."""
    link, ages = Link(), iter(ages_ms)

    def newest_ns():
        age_ms = next(ages)
        return None if age_ms is None else link.ns - age_ms * 1_000_000

    turns.pass_turn(link, TURN_NS, newest_ns)

    assert link.ns == TURN_NS
    assert list(ages) == [0], "it has waited as long as it had to"


def test_time_passes_where_messages_do_not_come(monkeypatch):
    monkeypatch.setattr(turns, "CATCH_UP_S", 0.01)
    link = Link()

    turns.pass_turn(link, TURN_NS, lambda: -1)
    turns.pass_turn(link, TURN_NS, lambda: -1)

    assert link.ns == 2 * TURN_NS


def test_a_client_outlives_the_virtual_drives(monkeypatch):
    """It takes turns until its process ends."""
    passed, ends = [], iter([LinkLostError("no virtual drives"), None, SystemExit()])

    def turn(*_):
        if (end := next(ends)) is not None:
            raise end
        passed.append(True)

    monkeypatch.setattr(client_process, "pass_turn", turn)
    monkeypatch.setattr(client_process, "RETRY_S", 0.0)
    with pytest.raises(SystemExit):
        client_process.take_turns(Link(), lambda: None)

    assert passed == [True]


def test_an_act_sees_the_newest_estimate_of_a_moment_unless_it_is_of_the_past():
    track = Track(RECEIVED)
    for number in range(3):
        track.add(number * CYCLE_NS, tuple(float(number) for _ in RECEIVED))

    assert track.at(2 * CYCLE_NS - 1)["gait_phase_ratio"] == 1.0
    assert track.at(60 * CYCLE_NS) == {}
    assert track.at(-1) == {}


# --- a training -----------------------------------------------------------------------------------


def history_of(folder, *, shares, end="complete", interruptions=()):
    """A history of one session; `shares` of each block, None: not valid."""
    profile = training.profile_of("right", folder / "profile.toml")
    with Store(folder / "history.sqlite", is_writer=True) as store:
        rows = [SessionRow(profile.id, "trainer", 1)]
        for number, of_block in enumerate(shares, 1):
            rows += [BlockRow(number, "walking", 0.5, 0.6, 8.0, 8.0)]
            rows += [GoalRow(number, "right", 0.3, 0.3)]
            rows += [
                StrideRow(number, "right", 10 * number + at, 2.0, share, 0.01, 1.0, 0.0, True)
                if share is not None
                else StrideRow(
                    number, "right", 10 * number + at, 2.0, None, None, None, None, False
                )
                for at, share in enumerate(of_block)
            ]
        rows += [InterruptionRow(1, "paused", reason) for reason in interruptions]
        store.write([*rows, EndRow(99, end)])
    return training.result_of(folder / "history.sqlite", profile)


KNOWN = ([0.3], [0.2, None, 0.4], [0.3])


def test_a_training_is_judged_by_its_history(tmp_path):
    result = history_of(tmp_path, shares=KNOWN)

    assert result.passed
    assert [block.stride_count for block in result.blocks] == [1, 3, 1]
    assert [list(block.shares) for block in result.blocks] == [[0.3], [0.2, 0.4], [0.3]]


@pytest.mark.parametrize(
    "failure",
    [
        {"shares": KNOWN[:2]},
        {"shares": [*KNOWN[:2], [None]]},
        {"shares": KNOWN, "end": "left"},
        {"shares": KNOWN, "interruptions": ["no signal"]},
    ],
    ids=["a block is missing", "no stride is known", "it was left", "it was interrupted"],
)
def test_a_training_fails(tmp_path, failure):
    result = history_of(tmp_path, **failure)

    assert not result.passed


def test_a_training_that_was_not_begun_has_no_result(tmp_path):
    file, profile = tmp_path / "history.sqlite", training.profile_of("right", tmp_path / "one.toml")
    assert training.result_of(file, profile) is None
    with Store(file, is_writer=True):
        pass
    assert training.result_of(file, profile) is None
