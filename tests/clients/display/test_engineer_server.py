"""The engineer's server: what the page gets, truth by SYNC, memory, and what it cannot do."""

import itertools
import shutil
import tomllib
from pathlib import Path

import display_bench as bench
import pytest
from gaitd_client import Cause, Health, Mode
from gaitd_display.engineer import EngineerServer, truth_paths
from gaitd_display.engineer_view import (
    CURVE_S,
    MINUTE_S,
    Memory,
    Row,
    Second,
    Span,
)
from gaitd_display.geometry import geometry_of
from gaitd_display.settings import EngineerSettings, read_settings
from gaitd_display.truth import KEPT, MATCH_NS, TAIL_BYTES, TrueEfforts, TruthFile
from gaitd_toml import ConfigError
from starlette.testclient import TestClient

from sim_drives.plant.truth import TruthRow

AHEAD_NS = bench.BEGAN_NS
CYCLE_NS = 10_000_000
COLUMNS = ",".join(TruthRow._fields)


def truth_line(sync_ns, hip_nm, slide_n=0.0):
    cells = dict.fromkeys(TruthRow._fields, "0")
    cells |= {"sync_mono_ns": str(sync_ns), "hip_patient_nm": str(hip_nm)}
    return ",".join((cells | {"slide_patient_n": str(slide_n)}).values()) + "\n"


def serve(trainer, folder, **given):
    settings = bench.settings_of(folder, bench.engineer_table(**given), EngineerSettings)
    return TestClient(
        EngineerServer(settings, trainer, lambda: AHEAD_NS).app, base_url=bench.ORIGIN
    )


def live(client):
    return client.websocket_connect("/live", headers=bench.OURS)


@pytest.mark.parametrize("legs", [("right",), ("right", "left")], ids=len)
def test_the_page_gets_each_leg_of_the_service_with_its_mechanism(tmp_path, legs):
    trainer = bench.MessageTrainer(legs)
    with serve(trainer, tmp_path) as client, live(client) as socket:
        page = bench.Page(socket)
        trainer.cycles(Mode.GAIT, power_w=4.0, count=3)
        health = {"work_max_us": 800.0, "lateness_max_us": 120.0, "bus_load_ratio": 0.1}
        health |= {"sample_time_ns": AHEAD_NS + trainer.clock.ns}
        trainer.send("health", bench.filled(Health, **health))
        now = page.until(lambda now: now["geometry"] is not None)
        past = client.get("/past.json").json()

    assert [leg["leg"] for leg in now["legs"]] == list(legs)
    assert [leg["power_w"] for leg in now["legs"]] == [4.0] * len(legs)
    for leg in now["legs"]:
        row = dict(zip(past["columns"], leg["row"], strict=True))
        assert (row["hip_angle_rad"], row["slide_position_m"]) == (0.2, 0.4)
        assert (row["hip_patient_nm"], row["hip_true_nm"]) == (8.0, None)
        assert row["time_ms"] == pytest.approx((AHEAD_NS + trainer.clock.ns) / 1e6)
    assert [drive["name"] for drive in now["drives"]] == [
        f"{leg}/{axis}" for leg in legs for axis in ("hip", "slide")
    ]
    assert now["mode"] == "gait"
    assert now["second"]["work_max_us"] == 800.0
    assert not now["has_truth"]
    geometry = bench.tables("robot.toml")["geometry"]
    assert now["geometry"]["thigh_m"] == geometry["thigh_length_m"]
    assert now["geometry"]["slide_max_m"] == 0.95
    assert trainer.requests == []


def test_of_a_silent_trainer_nothing_is_known(tmp_path):
    trainer = bench.MessageTrainer()
    with serve(trainer, tmp_path) as client, live(client) as socket:
        page = bench.Page(socket)
        trainer.cycles(Mode.FAULT, cause=Cause.HAND_SWITCH_OPEN)
        now = page.until(lambda now: now["verdict"] is not None and now["geometry"] is not None)
        assert (now["verdict"]["category"], now["verdict"]["cause"]) == ("S1", "hand_switch_open")
        assert now["drives"][0]["power_state"] == "operation_enabled"
        trainer.clock.ns += 250_000_000
        now = page.until(lambda now: now["time_ms"] is None)
        past = client.get("/past.json").json()

    assert now["mode"] is now["verdict"] is None
    assert now["progress"] == ""
    assert now["legs"] == [{"leg": "right", "row": None, "power_w": None, "power_w_std": None}]
    assert {value for drive in now["drives"] for value in list(drive.values())[1:]} == {None}
    newest = dict(zip(past["columns"], past["rows"]["right"][-1], strict=True))
    assert {name for name, value in newest.items() if value is not None} == {"time_ms"}
    assert [span["mode"] for span in past["spans"]][-2:] == ["fault", None]


def test_strides_and_events_come_with_their_time(tmp_path):
    trainer = bench.MessageTrainer()
    with serve(trainer, tmp_path) as client, live(client) as socket:
        page = bench.Page(socket)
        trainer.cycles(Mode.GAIT)
        trainer.step(1, 0.4, 3.0)
        page.until(lambda _: page.items)

    assert (page.items[0]["kind"], page.items[0]["share_ratio"]) == ("stride", 0.4)
    assert "time_ms" in page.items[0]


def test_it_reads_and_nothing_else(tmp_path):
    with serve(bench.MessageTrainer(), tmp_path) as client:
        page = client.get("/")
        assert page.status_code == 200
        policy = page.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        for path in ("/stop", "/act", "/plan"):
            assert client.post(path, headers=bench.OURS, json={}).status_code == 404
        for name in ("figure.js", "tokens.css", "fonts/LICENSE.AtkinsonHyperlegibleNext"):
            assert client.get(f"/static/{name}").status_code == 200


def test_a_page_without_login_is_on_loopback_alone(tmp_path):
    web = {"host": "0.0.0.0", "port": 8090, "certificate": "c.pem", "key": "k.pem"}
    table = bench.engineer_table() | {"web": web | {"origins": ["https://trainer.lan:8090"]}}
    with pytest.raises(ConfigError, match=r"127.0.0.1, because .* without login"):
        bench.settings_of(tmp_path, table, EngineerSettings)


def test_the_shipped_file_is_good_and_its_truth_is_relative_to_it(tmp_path):
    shipped = Path(bench.CONFIGS.parent / "clients/display/configs/engineer.toml")
    assert read_settings(shipped, EngineerSettings).truth is None
    file = Path(shutil.copy(shipped, tmp_path))
    file.write_text('truth = "truth.csv"\n' + file.read_text(encoding="utf-8"), encoding="utf-8")
    assert read_settings(file, EngineerSettings).truth == tmp_path / "truth.csv"


# --- truth --------------------------------------------------------------------------------------


def test_the_truth_of_an_estimate_is_that_of_its_sync(tmp_path):
    path = tmp_path / "truth.csv"
    trainer = bench.MessageTrainer()
    with serve(trainer, tmp_path, truth=str(path)) as client, live(client) as socket:
        page = bench.Page(socket)
        lines = [truth_line(n * CYCLE_NS, float(n), -float(n)) for n in range(1, 6)]
        path.write_text(f"{COLUMNS}\n{''.join(lines)}", encoding="utf-8")
        trainer.cycles(Mode.GAIT, power_w=4.0, count=3)
        page.until(lambda now: now["has_truth"])
        trainer.cycles(Mode.GAIT, power_w=4.0)
        newest_ms = (AHEAD_NS + trainer.clock.ns) / 1e6
        page.until(lambda now: now["time_ms"] == newest_ms)
        past = client.get("/past.json").json()

    row = dict(zip(past["columns"], past["rows"]["right"][-1], strict=True))
    assert (row["hip_true_nm"], row["slide_true_n"]) == (4.0, -4.0)


@pytest.fixture
def truth(tmp_path):
    file = TruthFile(tmp_path / "truth.csv", lambda: AHEAD_NS)
    yield file
    file.close()


def at(truth, mono_ns):
    truth.read()
    return truth.at(AHEAD_NS + mono_ns)


def test_a_file_that_is_not_there_yet_is_waited_for_and_half_a_line_too(truth):
    assert at(truth, CYCLE_NS) is None
    line = truth_line(CYCLE_NS, 8.5, 3.0)
    with truth.path.open("w", encoding="utf-8") as file:
        for part in (COLUMNS[:20], f"{COLUMNS[20:]}\n{line[:30]}"):
            file.write(part)
            file.flush()
            assert at(truth, CYCLE_NS) is None
        file.write(line[30:])
    assert at(truth, CYCLE_NS) == TrueEfforts(8.5, 3.0)
    assert truth.trouble == ""


def test_two_syncs_are_never_taken_for_one(truth):
    truth.path.write_text(f"{COLUMNS}\n{truth_line(CYCLE_NS, 8.5)}", encoding="utf-8")
    assert at(truth, CYCLE_NS + MATCH_NS + 1) is None
    assert at(truth, CYCLE_NS - MATCH_NS - 1) is None


def test_a_clock_that_is_slewed_for_hours_does_not_separate_them(truth):
    drift_ns = 100_000
    steps = range(1, 500)
    lines = "".join(truth_line(n * CYCLE_NS, float(n)) for n in steps)
    truth.path.write_text(f"{COLUMNS}\n{lines}", encoding="utf-8")

    found = [at(truth, n * CYCLE_NS + n * drift_ns) for n in steps]

    assert steps[-1] * drift_ns > 2 * CYCLE_NS
    assert [efforts and efforts.hip_patient_nm for efforts in found] == [float(n) for n in steps]


def test_of_a_long_file_the_end_is_read_and_a_new_run_replaces_it(truth):
    long = " " * 200
    count = 3 * TAIL_BYTES // len(long)
    lines = "".join(truth_line(n * CYCLE_NS, f"{n}{long}") for n in range(1, count))
    truth.path.write_text(f"{COLUMNS}\n{lines}", encoding="utf-8")
    tail_count = TAIL_BYTES // len(long)
    assert tail_count < KEPT
    assert at(truth, (count - tail_count) * CYCLE_NS) is None
    assert at(truth, (count - 1) * CYCLE_NS) == TrueEfforts(count - 1.0, 0.0)

    truth.path.write_text(f"{COLUMNS}\n{truth_line(7 * CYCLE_NS, 2.0)}", encoding="utf-8")
    assert at(truth, 7 * CYCLE_NS) == TrueEfforts(2.0, 0.0)
    assert at(truth, (count - 1) * CYCLE_NS) is None


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("time_s,hip_angle_rad\n0,0\n", "no column hip_patient_nm, slide_patient_n, sync_mono_ns"),
        (f"{COLUMNS}\n1,2\n", "a row without numbers: b'1,2'"),
    ],
)
def test_a_file_of_another_kind_is_told(truth, content, said):
    truth.path.write_text(content, encoding="utf-8")
    assert at(truth, CYCLE_NS) is None
    assert said in truth.trouble


def test_a_path_that_cannot_be_read_is_told(tmp_path):
    folder = TruthFile(tmp_path, lambda: AHEAD_NS)
    assert at(folder, CYCLE_NS) is None
    assert "is a directory" in folder.trouble


def test_the_files_are_named_as_the_virtual_drives_name_them():
    assert truth_paths(None, ("right",)) == {}
    assert truth_paths(Path("t.csv"), ("left",)) == {"left": Path("t.csv")}
    assert truth_paths(Path("t.csv"), ("right", "left")) == {
        "right": Path("t_right.csv"),
        "left": Path("t_left.csv"),
    }


# --- memory -------------------------------------------------------------------------------------


def row(time_s):
    return Row(1000.0 * time_s, hip_validity="ok", slide_validity="ok")


def test_the_memory_is_of_the_last_seconds_of_the_records(tmp_path):
    memory = Memory(["right"])
    for time_s in range(200):
        mode = "hold" if time_s < 100 else "gait" if time_s < 190 else "stopping"
        memory.add_row("right", row(time_s))
        memory.add_span(Span(1000.0 * time_s, mode, None, None))
        memory.add_second(Second(1000.0 * time_s, None, None, None, None, 0, None, None))
        memory.add_second(Second(1000.0 * time_s, None, None, None, None, 0, None, None))
    past = memory.past()

    assert [one.time_ms for one in past.rows["right"]] == [
        1000.0 * time_s for time_s in range(199 - int(CURVE_S), 200)
    ]
    assert len(past.seconds) == MINUTE_S + 1
    assert [(one.mode, one.time_ms) for one in past.spans] == [
        ("gait", 100_000.0),
        ("stopping", 190_000.0),
    ]


def test_a_gap_is_one_unknown_row_and_another_run_begins_anew():
    memory = Memory(["right"])
    memory.add_row("right", None)
    for one in (row(50), row(50), None, None, row(51), row(51)):
        memory.add_row("right", one)
    memory.add_span(Span(51_000.0, "gait", None, None))
    validities = [one.hip_validity for one in memory.past().rows["right"]]
    assert validities == ["ok", None, "ok"]

    memory.add_row("right", row(1))
    past = memory.past()
    assert [one.time_ms for one in past.rows["right"]] == [1000.0]
    assert past.spans == past.seconds == []


def test_files_without_a_mechanism_have_no_geometry():
    robot = tomllib.loads((bench.CONFIGS / "robot.toml").read_text(encoding="utf-8"))
    limits = tomllib.loads((bench.CONFIGS / "limits.toml").read_text(encoding="utf-8"))
    assert geometry_of(robot, limits) is not None
    for name in itertools.chain(robot["geometry"]):
        less = {key: value for key, value in robot["geometry"].items() if key != name}
        assert geometry_of({"geometry": less}, limits) is None
    assert geometry_of({}, limits) is geometry_of(robot, {}) is None
