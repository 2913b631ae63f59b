"""Recordings of a virtual trainer: read by others, replayed to the same bits, torn, and bounded."""

import json
import os
import random
import re
import shutil
from types import SimpleNamespace

import matplotlib
import matplotlib.pyplot as plt
import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import gaitd
from duckdb_program import rows_of
from gaitd_client import Target, wire
from gaitd_names import Mode
from gaitd_record import (
    MESSAGES,
    PART,
    Begun,
    Deleted,
    Finished,
    FullError,
    Head,
    Ignored,
    Options,
    Purpose,
    Recorder,
    Recording,
    Room,
    Unfinished,
    WhenFull,
    finish,
)
from gaitd_record import record as run_record
from mcap.reader import make_reader
from power_cuts import check
from recorded_sessions import published_by, record, recorder
from records import states_of
from sessions import CONFIGS, new_session
from traced_calls import mark

from analysis.recording import RecordingError, read_csv
from analysis.replay import estimate, legs_of, read

PROJECT = CONFIGS.parent
ROBOTS = {"calibrate": "robot_empty.toml"}
SYNC_CYCLES = 50
"""Half a second, as the recorder's timer."""


@pytest.fixture(scope="module")
def session():
    """From power-on: seven strides, a stop in the eighth, at rest."""
    session = new_session().walk(cadence_hz=0.5, duration_s=16.0)
    session.gateway.stop()
    session.until(Mode.FAULT, within_s=5.0)
    session.run(0.5)
    return session


@pytest.fixture(scope="module")
def published(session):
    return published_by(session)


@pytest.fixture(scope="module")
def whole(published, tmp_path_factory):
    return record(published, tmp_path_factory.mktemp("whole"))


def test_a_replay_of_a_whole_recording_gives_the_published_estimates_bit_for_bit(session, whole):
    source = read(whole.path)

    replayed = estimate(source, source.robot)

    live = [record.legs[0] for record in session.records][-len(replayed.state) :]
    assert len(live) > 1500
    assert legs_of(whole.path) == ("right",)
    assert source.robot == session.settings.robot
    assert replayed.state.tobytes() == np.array([states_of(leg) for leg in live]).tobytes()
    assert replayed.std.tobytes() == np.array([states_of(leg, "_std") for leg in live]).tobytes()
    assert replayed.status.tolist() == [leg.status for leg in live]


def test_mcap_has_every_message_but_estimates_as_published_with_its_schema(published, whole):
    others = [one for one in published.messages if not one.key.endswith("/estimate")]
    with (whole.path / MESSAGES).open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        told = [
            ((channel.topic[1:], schema.name, message.data, message.log_time), message.publish_time)
            for schema, channel, message in reader.iter_messages(log_time_order=False)
        ]
        schemas = reader.get_summary().schemas.values()
        metadata = {one.name: one.metadata for one in reader.iter_metadata()}
        (attached,) = reader.iter_attachments()

    assert [message for message, _ in told] == others
    heads = [msgspec.json.decode(one.payload, type=Head) for one in others]
    assert [time_ns for _, time_ns in told] == [head.sample_time_ns for head in heads]
    assert {one.encoding for one in schemas} == {"jsonschema"}
    assert all(json.loads(one.data)["$id"] == one.name for one in schemas)
    begin, end = metadata["gaitd"], metadata["gaitd.end"]
    assert len(begin["id"]) == 16
    assert json.loads(begin["config_hashes"]) == published.header.config_hashes
    assert json.loads(attached.data)["robot"] == published.header.robot
    assert json.loads(begin["joints"])["slide"]["effort"] == "N"
    modes = [change["mode"] for change in json.loads(end["modes"])]
    assert modes == ["bringing_up", "ready", "hold", "gait", "stopping", "fault"]
    assert [stop["cause"] for stop in json.loads(end["stops"])] == ["stop_requested"]
    assert (whole.ended, whole.lost) == ("in order", {})
    assert whole.message_count == len(published.messages)


def test_another_program_reads_estimates_and_exports_a_recording_as_csv(published, whole, tmp_path):
    fields = (
        "cycle, mode, hip_patient_nm, hip_patient_nm_std, slide_velocity_m_per_s,"
        " reference_hip_angle_rad, innovation_slide_m, assist_slide_n, slide_validity, status"
    )
    rows = rows_of(f"SELECT {fields} FROM '{whole.path}/right.estimates.parquet'")
    csv = tmp_path / "exported.csv"
    rows_of(f"COPY (FROM '{whole.path}/right.recording.parquet') TO '{csv}'")

    messages = published.of("right/estimate", wire.Estimate)

    def single(value):
        return None if value is None else float(np.float32(value))

    assert rows == [
        [
            one.cycle,
            one.mode,
            single(one.hip.patient),
            single(one.hip.patient_std),
            single(one.slide.velocity),
            single(one.hip.reference_position),
            single(one.slide.innovation),
            single(one.slide.assist),
            one.slide.validity,
            int(one.status_bits, 16),
        ]
        for one in messages
    ]
    ours, theirs = read(whole.path).recording, read_csv(csv)
    first = len(theirs.time_s) - len(ours.time_s)
    for name in ("time_s", "position", "effort"):
        assert getattr(ours, name).tobytes() == getattr(theirs, name)[first:].tobytes()


@pytest.fixture(scope="module")
def same_rows(whole, tmp_path_factory):
    """The rows of the recording as Parquet without its metadata, and as CSV."""
    folder = tmp_path_factory.mktemp("same")
    rows, csv = folder / "same.parquet", folder / "same.csv"
    table = pq.read_table(whole.path / "right.recording.parquet").replace_schema_metadata()
    pq.write_table(table.filter(table["hip_angle_rad"].is_valid()), rows)
    rows_of(f"COPY (FROM '{rows}') TO '{csv}'")
    return rows, csv


@pytest.mark.parametrize(
    "words",
    [
        ("delay",),
        ("calibrate", "--check"),
        ("replay", "--output", "made.txt"),
    ],
    ids=lambda words: words[0],
)
def test_a_command_reads_a_recording_as_it_reads_the_same_rows_as_csv(
    whole, same_rows, tmp_path, words
):
    rows, csv = same_rows
    robot, written = tmp_path / "robot.toml", tmp_path / "made.txt"
    shutil.copy(CONFIGS / ROBOTS.get(words[0], "robot.toml"), robot)

    def made(recording):
        ran = gaitd(words[0], recording, *words[1:], "--robot", robot, folder=tmp_path)
        told = [line for line in ran.out.splitlines() if "x real time" not in line]
        text = written.read_text().replace(recording.name, "") if written.exists() else ""
        return ran.code, "\n".join(told).replace(str(recording), ""), text, ran.err

    by_csv = made(csv)

    assert by_csv[0] in {0, 1}, by_csv[-1]
    assert made(rows) == by_csv
    of_service = made(whole.path)
    if words[0] == "calibrate":
        assert "was recorded with a patient in the machine" in of_service[-1]
    else:
        assert of_service[0] == by_csv[0], of_service[-1]


TABLES = ("right.recording", "right.estimates", "events")


def test_tables_tell_units_and_meanings_and_are_joined_by_boot_and_cycle(published, whole):
    tables = {name: pq.read_table(whole.path / f"{name}.parquet") for name in TABLES}
    told = {
        (name, field.name): {key.decode(): text.decode() for key, text in field.metadata.items()}
        for name, table in tables.items()
        for field in table.schema
    }
    axis = wire.schema(wire.Estimate)["$defs"]["AxisEstimate"]["properties"]
    events = published.of(wire.EVENTS, wire.Event)
    estimates = tables["right.estimates"]
    query = (
        f"SELECT typeof(e.time_utc), e.code, x.mode FROM '{whole.path}/events.parquet' e JOIN"
        f" '{whole.path}/right.estimates.parquet' x USING (core_boot_id, cycle)"
        " WHERE e.kind = 'stop'"
    )

    assert all(words.keys() == {"unit", "meaning"} for words in told.values())
    assert all(words["meaning"] for words in told.values())
    units = {
        ("right.estimates", "hip_patient_nm_std"): "N·m",
        ("right.estimates", "slide_velocity_m_per_s"): "m/s",
        ("right.estimates", "hip_tremor_frequency_hz"): "Hz",
        ("right.estimates", "stiffness_ratio"): "1",
        ("right.estimates", "hip_validity"): "",
        ("right.recording", "slide_force_n"): "N",
        ("right.recording", "dt_s"): "s",
        ("events", "time_utc"): "ns",
    }
    assert {column: told[column]["unit"] for column in units} == units
    patient = told["right.estimates", "slide_patient_n"]
    assert patient["meaning"] == axis["patient"]["description"]
    heads = published.of("right/estimate", wire.Estimate)
    for name in ("right.recording", "right.estimates"):
        times = tables[name]["time_utc"]
        assert times.type == pa.timestamp("ns", tz="UTC")
        assert times.cast(pa.int64()).to_pylist() == [one.sample_time_ns for one in heads]
    assert estimates["core_boot_id"].unique().to_pylist() == ["boot"]
    assert [
        (row["id"], row["kind"], row["code"], row["cause"], json.loads(row["values_json"]))
        for row in tables["events"].to_pylist()
    ] == [(one.id, one.kind, one.code, one.cause, one.values) for one in events]
    assert rows_of(query) == [["TIMESTAMPTZ_NS", "stopped", "stopping"]]


def part_of(published, folder, count):
    """A recording whose recorder was killed after so many messages, and its files at each sync."""
    made = recorder(published, folder)
    sizes = []
    for index, one in enumerate(published.messages[:count]):
        made.add(one)
        if one.key == "right/estimate" and index % SYNC_CYCLES == 0:
            made.sync()
            (part,) = folder.glob(f"*{PART}")
            sizes.append((index + 1, {file.name: file.stat().st_size for file in part.iterdir()}))
    return part, sizes, made


def kept_of(path):
    """Estimates and other messages of a finished recording, by their keys and numbers."""
    kept = []
    with (path / MESSAGES).open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            kept.append((channel.topic[1:], message.data))
    estimates = path / "right.estimates.parquet"
    cycles = pq.read_table(estimates)["cycle"].to_pylist() if estimates.exists() else []
    return cycles, kept


def test_whatever_a_kill_or_a_power_cut_leaves_has_all_up_to_the_last_sync(published, tmp_path):
    """Each file is cut at any byte behind its last sync, and may end in bytes never written."""
    (tmp_path / "killed").mkdir()
    part, syncs, _ = part_of(published, tmp_path / "killed", 600)
    draw = random.Random(24)
    for number in range(12):
        copy = tmp_path / f"{number}{PART}"
        shutil.copytree(part, copy)
        count, sizes = draw.choice(syncs)
        for file in copy.iterdir():
            end = draw.randint(sizes.get(file.name, 0), file.stat().st_size)
            content = file.read_bytes()[:end]
            file.write_bytes(content + draw.choice((b"", bytes(draw.randint(1, 5000)))))

        finished = finish(copy)

        assert finished is not None
        cycles, others = kept_of(finished.path)
        before, every = published.messages[:count], published.messages
        least = [one for one in before if one.key.endswith("/estimate")]
        assert len(least) <= len(cycles)
        assert (
            cycles
            == [one.cycle for one in published.of("right/estimate", wire.Estimate)][: len(cycles)]
        )
        told = [(one.key, one.payload) for one in every if not one.key.endswith("/estimate")]
        assert count - len(least) <= len(others)
        assert others == told[: len(others)]
        assert finished.ended.startswith("torn")
        assert finished.message_count == len(cycles) + len(others)


def test_a_power_cut_at_any_call_of_the_recorder_loses_nothing_before_the_last_sync(
    published, tmp_path
):
    folder = tmp_path / "folder"
    folder.mkdir()
    messages = published.messages[1000:1012]

    def scenario():
        with recorder(published, folder) as made:
            for index, one in enumerate(messages):
                made.add(one)
                if index == 7:
                    made.sync()
                    mark(f"{index + 1}")
        mark(f"{len(messages)}")

    def recover(marks):
        events = []
        recorder(published, folder, events=events)
        finished = [file.parent for file in folder.glob(f"*/{MESSAGES}")]
        assert not [event for event in events if isinstance(event, Unfinished)]
        assert not [path for path in finished if path.name.endswith(PART)]
        assert not events or marks[-1:] != (f"{len(messages)}",)
        if not finished:
            assert not marks
            return
        cycles, others = kept_of(finished[0])
        told = [(one.key, one.payload) for one in messages if not one.key.endswith("/estimate")]
        assert others == told[: len(others)]
        assert len(cycles) + len(others) >= (int(marks[-1]) if marks else 0)

    check(folder, scenario, recover, random_count=1)


def test_the_newest_recording_stays_although_the_clock_has_lost_its_time(published, tmp_path):
    paths = []
    for days in (9, 0, 1):
        part, _, made = part_of(published, tmp_path / f"from{days}", 60)
        made.end()
        made.__exit__()
        (made_path,) = part.parent.iterdir()
        moved = made_path.rename(tmp_path / f"{days}{PART}")
        os.utime(moved / MESSAGES, (days * 86400, days * 86400))
        paths.append(finish(moved).path)

    newest_last = sorted(paths, key=lambda path: (path / MESSAGES).stat().st_mtime_ns)
    assert newest_last == paths


def test_a_kill_while_a_recording_is_finished_changes_nothing(published, whole, tmp_path):
    (tmp_path / "killed").mkdir()
    part, _, _ = part_of(published, tmp_path / "killed", 3000)
    first = shutil.copytree(part, tmp_path / f"first{PART}")
    again = shutil.copytree(part, tmp_path / f"again{PART}")
    assert finish(first) is not None
    shutil.copy(tmp_path / "first" / MESSAGES, again)  # after this step
    for name in TABLES:  # and within the next
        (again / f"{name}.parquet.new").write_bytes(b"half")

    assert finish(again) is not None

    assert kept_of(tmp_path / "again") == kept_of(tmp_path / "first")
    assert {file.name for file in (tmp_path / "again").iterdir()} == {
        file.name for file in whole.path.iterdir()
    }


def test_a_recorder_that_starts_finishes_what_is_left_and_leaves_what_is_being_made(
    published, tmp_path
):
    part, _, made = part_of(published, tmp_path, 1000)
    other = tmp_path / f"left{PART}"
    shutil.copytree(part, other)
    (tmp_path / f"download{PART}").touch()
    (tmp_path / f"theirs{PART}").mkdir()
    events = []

    recorder(published, tmp_path, events=events)
    command = gaitd("record", "--finish", "--output", tmp_path, "--json")

    assert [event.path.name for event in events] == ["left"]
    assert (command.code, command.out) == (0, "")
    assert part.exists()
    made.end()
    made.__exit__()
    assert {one.name for one in tmp_path.glob(f"*{PART}")} == {"download.part", "theirs.part"}


def test_what_cannot_be_finished_stays_and_ends_no_recorder(published, tmp_path):
    part, _, made = part_of(published, tmp_path, 1000)
    made.end()
    made.__exit__()
    (finished,) = [one for one in tmp_path.iterdir() if one != part]
    taken = tmp_path / f"{finished.name}{PART}"
    shutil.copytree(finished, taken)
    older = tmp_path / f"older{PART}"
    shutil.copytree(finished, older)
    text = (older / MESSAGES).read_bytes()
    key = b"\6\0\0\0joints"  # as long as the key of another version in its place
    assert text.count(key) == 1
    (older / MESSAGES).write_bytes(text.replace(key, b"\6\0\0\0spring"))
    events = []

    with recorder(published, tmp_path, events=events) as again:
        for one in published.messages[-10:]:
            again.add(one)

    told = {event.path: event.reason for event in events if isinstance(event, Unfinished)}
    assert set(told) == {taken, older}
    assert f"cannot become {finished}, which is there already" in told[taken]
    assert "is of another program or version" in told[older]
    assert "`joints`" in told[older]
    assert taken.exists()
    assert older.exists()
    assert isinstance(events[-1], Finished)


ESTIMATE = "right/estimate"


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("left/estimate", {}),
        (ESTIMATE, {"status_bits": "f" * 9}),
        (ESTIMATE, {"status_bits": "none"}),
        (ESTIMATE, {"cycle": 2**70}),
        (ESTIMATE, {"cycle": -1}),
        (ESTIMATE, {"sample_time_ns": 2**63}),
        (ESTIMATE, {"hip": {"effort": "much"}}),
        (wire.SAFETY, {"verdict": 1}),
        (wire.EVENTS, {"time_ns": 2**63}),
        ("foreign", {"seq": -1}),
        ("foreign", None),
    ],
)
def test_a_message_that_is_none_of_gaitd_s_is_reported_and_costs_only_itself(
    published, tmp_path, key, change
):
    like = key if key in {wire.SAFETY, wire.EVENTS} else ESTIMATE
    first = next(n for n, one in enumerate(published.messages) if one.key == like)
    good = published.messages[first]
    bad = b"[" * 5000
    if change is not None:
        bad = msgspec.json.encode(msgspec.json.decode(good.payload) | change)
    forged = good._replace(key=key, payload=bad)
    events = []

    with recorder(published, tmp_path, events=events) as made:
        for one in (*published.messages[: first + 1], forged, forged):
            made.add(one)

    (ignored,) = [event for event in events if isinstance(event, Ignored)]
    assert ignored.key == key
    assert ignored.reason
    assert events[-1].ended == "in order"
    assert events[-1].message_count == first + 1


def test_training_and_calibration_have_the_modes_that_they_are_for(published, tmp_path):
    training = record(published, tmp_path / "training", Purpose.TRAINING)
    events = []
    with recorder(published, tmp_path / "calibration", Purpose.CALIBRATION, events) as made:
        for one in published.messages:
            made.add(one)
        for one in published.messages:  # the same, excited by another core
            excited = one.payload.replace(b'"gait"', b'"excite"')
            made.add(one._replace(payload=excited.replace(b'"boot"', b'"reboot"')))

    estimates = pq.read_table(training.path / "right.estimates.parquet")
    modes = estimates["mode"].to_pylist()
    assert modes[0] == "hold"
    assert set(modes) == {"hold", "gait", "stopping", "fault"}
    assert read(training.path).first_step_s is None
    begun = [event.path.name for event in events if isinstance(event, Begun)]
    assert begun == ["gait_1", "excite_1"]


def test_another_core_is_another_recording_and_a_gap_is_a_loss(published, tmp_path):
    events = []
    lossy = [one for index, one in enumerate(published.messages) if index % 100 != 50]
    with recorder(published, tmp_path, events=events) as made:
        for one in lossy[:2000]:
            made.add(one)
        for one in lossy[2000:2100]:
            made.add(one._replace(payload=one.payload.replace(b'"boot"', b'"reboot"')))
        made.add(lossy[1990])  # late
        for one in lossy[2100:2200]:
            made.add(one)

    assert "another core" in next(event.reason for event in events if isinstance(event, Ignored))
    first, second, third = (event for event in events if isinstance(event, Finished))
    assert sum(first.lost.values()) == 20
    assert first.message_count == 2000
    assert (second.message_count, second.lost) == (100, {})
    assert third.message_count == 100  # a message with another core's id takes nothing from a core
    source = read(first.path)
    steps_s = np.diff(source.recording.time_s)
    assert np.all(np.isclose(steps_s % 0.01, 0) | np.isclose(steps_s % 0.01, 0.01))
    assert steps_s.max() > 0.015


@pytest.mark.parametrize("when_full", WhenFull)
def test_a_full_folder_loses_its_oldest_recording_or_takes_no_other(
    published, whole, tmp_path, when_full
):
    for name in ("old", "older"):
        shutil.copytree(whole.path, tmp_path / name)
    for age, name in enumerate(("old", "older")):
        os.utime(tmp_path / name / MESSAGES, ns=(0, 10**18 - age * 10**15))
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "notes.txt").write_bytes(bytes(4_000_000))
    (tmp_path / "older" / "notes.txt").write_text("beside a recording")
    events = []
    room = Room(tmp_path, 3, when_full)
    made = Recorder(Options(Purpose.ALL, room), published.configuration, events.append)
    for one in published.messages:
        made.add(one)
    made.sync()

    if when_full is WhenFull.DELETE_OLDEST:
        made.make_room()
        assert [event.path.name for event in events if isinstance(event, Deleted)] == ["older"]
    else:
        with pytest.raises(FullError, match=r"its recordings have \d MB, allowed are 3 MB"):
            made.make_room()
        assert (tmp_path / "older").exists()
    made.__exit__()
    finished = next(event for event in events if isinstance(event, Finished))
    assert finished.message_count == len(published.messages)
    assert ("in order" in finished.ended) is (when_full is WhenFull.DELETE_OLDEST)
    assert (tmp_path / "theirs" / "notes.txt").exists()
    assert (tmp_path / "older" / "notes.txt").exists()


def changed(one, **fields):
    return one._replace(payload=msgspec.json.encode(msgspec.json.decode(one.payload) | fields))


@pytest.mark.parametrize("purpose", [Purpose.ALL, Purpose.TRAINING])
def test_a_mark_during_a_training_is_in_its_messages_and_its_table_of_events(
    published, tmp_path, purpose
):
    walked = published.messages[1000:3000]
    at = msgspec.json.decode(walked[1000].payload, type=Head)
    event = next(one for one in published.messages if one.key == wire.EVENTS)
    given = {"cycle": at.cycle, "sample_time_ns": at.sample_time_ns, "mode": "gait"}
    marked = changed(event, **given, id="x", code="mark", kind="note", said="right knee")
    events = []

    with recorder(published, tmp_path, purpose, events) as made:
        for one in [*walked[:1000], marked, *walked[1000:]]:
            made.add(one)

    finished = next(one for one in events if isinstance(one, Finished))
    table = pq.read_table(finished.path / "events.parquet").to_pylist()
    assert [row["said"] for row in table if row["code"] == "mark"] == ["right knee"]
    with (finished.path / MESSAGES).open("rb") as file:
        read_back = [one.data for *_, one in make_reader(file).iter_messages(log_time_order=False)]
    assert read_back.count(marked.payload) == 1


@pytest.mark.parametrize("purpose", [Purpose.ALL, Purpose.TRAINING])
def test_messages_that_others_have_overtaken_begin_and_end_no_recording(
    published, tmp_path, purpose
):
    """Each 20th comes three seconds late; some of them after the end of the training."""
    walked = published.messages[:3000]
    heads = [msgspec.json.decode(one.payload, type=Head) for one in walked]
    cycles = [head.cycle or 0 for head in heads]
    ended_ns = heads[-1].sample_time_ns + 2_500_000_000
    ended = changed(walked[-1], mode="ready", cycle=cycles[-1] + 250, sample_time_ns=ended_ns)
    due = [(cycle + (0 if n % 20 else 300), n) for n, cycle in enumerate(cycles)]
    events = []

    with recorder(published, tmp_path, purpose, events) as made:
        for _, n in sorted([*due, (cycles[-1] + 250, len(walked))]):
            made.add([*walked, ended][n])

    assert [type(event) for event in events if not isinstance(event, Ignored)] == [Begun, Finished]


@pytest.mark.parametrize("clock_s", [-10, 10, 0], ids=["set_back", "set_forth", "full"])
def test_another_recording_continues_without_a_gap(published, tmp_path, monkeypatch, clock_s):
    """The clock is set, or the longest time is over, at a message without a mode."""
    heads = [msgspec.json.decode(one.payload, type=Head) for one in published.messages]
    walked = sorted(range(1000, 2200), key=lambda n: (heads[n].cycle, published.messages[n].key))
    first = next(
        index
        for index, n in enumerate(walked)
        if index > 600 and published.messages[n].key.startswith("drives/")
    )
    if not clock_s:
        longest = heads[walked[first]].cycle - heads[walked[0]].cycle - 1
        monkeypatch.setattr("gaitd_record.program.LONGEST_NS", longest * 10_000_000)
    events = []

    with recorder(published, tmp_path, Purpose.TRAINING, events) as made:
        for index, n in enumerate(walked):
            set_ns = clock_s * 1_000_000_000 if index >= first else 0
            time_ns = heads[n].sample_time_ns + set_ns
            made.add(changed(published.messages[n], sample_time_ns=time_ns))

    finished = [event for event in events if isinstance(event, Finished)]
    assert len(finished) == 2
    assert sum(one.message_count for one in finished) == len(walked)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("made.part", "is not finished; `gaitd record --finish --output"),
        ("empty", "has no file LEG.recording.parquet"),
        ("whole/messages.mcap", "has no inputs of the observer; name its folder"),
        (
            "whole/right.estimates.parquet",
            "lacks column hip_torque_nm, slide_force_n; it has",
        ),
        ("torn.parquet", "is no whole Parquet file"),
        ("words.parquet", "column hip_angle_rad is string, must be a number"),
        ("gone.parquet", "No such file"),
        ("never.parquet", "the observer ran in none of its"),
        ("latin.parquet", "its metadata are of another version"),
    ],
)
def test_what_is_no_recording_is_refused_by_name(whole, tmp_path, name, said):
    shutil.copytree(whole.path, tmp_path / "whole")
    (tmp_path / "made.part").mkdir()
    (tmp_path / "empty").mkdir()
    file = tmp_path / "whole" / "right.recording.parquet"
    (tmp_path / "torn.parquet").write_bytes(file.read_bytes()[:-100])
    table = pq.read_table(file)
    at = table.column_names.index("hip_angle_rad")
    words = table.set_column(at, "hip_angle_rad", pa.array(["0.1"] * len(table)))
    pq.write_table(words, tmp_path / "words.parquet")
    pq.write_table(table[:40], tmp_path / "never.parquet")
    latin = table.replace_schema_metadata({b"gaitd.leg": b"gau\xdfe", b"gaitd": b"\xff"})
    pq.write_table(latin, tmp_path / "latin.parquet")

    ran = gaitd("replay", name, folder=tmp_path)

    assert ran.code == 2
    assert ran.err.startswith(f"{name}: ")
    assert said in ran.err


def test_a_leg_that_was_not_recorded_is_refused(whole):
    with pytest.raises(RecordingError, match="has no leg left, only right"):
        read(whole.path, "left")


def test_every_path_of_the_viewers_layout_is_a_field_that_a_viewer_can_read(whole):
    layout = json.loads((PROJECT / "clients" / "record" / "layout.json").read_text())
    panels = layout["configById"].values()
    paths = {one["value"] for panel in panels for one in panel.get("paths", ())}
    paths |= {panel["topicPath"] for panel in panels if "topicPath" in panel}
    with (whole.path / MESSAGES).open("rb") as file:
        channels = make_reader(file).get_summary()
    schemas = {
        channel.topic: json.loads(channels.schemas[channel.schema_id].data)
        for channel in channels.channels.values()
    }

    assert len(paths) > 10
    for path in paths:
        topic, *fields = path.split(".")
        node = schemas[topic]
        for name in fields:
            node = node["properties"][name]
    # What Lichtblick's parseJsonSchema accepts: one type for each field and each array's items.
    nodes = list(schemas.values())
    for node in nodes:
        assert node["type"] in {"object", "array", "string", "number", "integer", "boolean"}
        nodes += node.get("properties", {}).values()
        nodes += [node["items"]] if node["type"] == "array" else []


class Played:
    """A trainer, its session and its clock: messages come at their own times."""

    def __init__(self, published):
        self.published, self.now = published, 0
        self.target = Target(trainer="trainer")
        self.configuration = published.configuration
        self.key = ""
        self.waiting = [
            (msgspec.json.decode(one.payload, type=Head).sample_time_ns or 0, one)
            for one in published.messages[:2000]
        ]

    def connected_session(self):
        return self

    def declare_subscriber(self, key, take):
        self.key, self.take = key, take
        return self

    def undeclare(self):
        """The subscriber's."""

    def now_ns(self):
        """Each look at the clock lets a cycle pass, and its messages arrive."""
        self.now = max(self.now + 10_000_000, self.waiting[0][0] if self.waiting else 0)
        while self.waiting and self.waiting[0][0] <= self.now:
            _, (key, schema, payload, _) = self.waiting.pop(0)
            self.take(Sample(f"gaitd/trainer/{key}", f"application/json;{schema}", payload))
        return self.now

    def is_set(self):
        return not self.waiting


class Sample:
    def __init__(self, key, encoding, payload):
        self.key_expr, self.encoding, self.payload = key, encoding, self
        self.to_bytes = lambda: payload


def test_what_came_is_on_the_disk_within_less_than_a_second_with_its_time_of_receipt(
    published, tmp_path, monkeypatch
):
    played = Played(published)
    played.take = lambda sample: None
    synced_ns = []
    received_ns = []

    def receive_ns():
        received_ns.append(played.now + 500)
        return received_ns[-1]

    monkeypatch.setattr("gaitd_record.program.MonotonicClock", lambda: played)
    monkeypatch.setattr("gaitd_record.program.UtcClock", lambda: SimpleNamespace(now_ns=receive_ns))
    sync = Recording.sync

    def watched(recording):
        sync(recording)
        synced_ns.append(played.now)

    monkeypatch.setattr(Recording, "sync", watched)
    events = []

    run_record(played, Options(Purpose.ALL, Room(tmp_path, 1000)), events.append, played)

    assert played.key == "gaitd/trainer/**"
    assert len(synced_ns) > 5
    assert max(np.diff(synced_ns)) < 600_000_000
    assert [type(event).__name__ for event in events] == ["Listening", "Begun", "Finished"]
    assert events[-1].message_count > 1900
    with (events[-1].path / MESSAGES).open("rb") as file:
        read_back = make_reader(file).iter_messages(log_time_order=False)
        logged_ns = [message.log_time for _, _, message in read_back]
    assert len(logged_ns) > 500
    assert set(logged_ns) <= set(received_ns)


def test_the_notebook_draws_its_pictures_of_a_recording(whole):
    matplotlib.use("Agg")
    notebook = json.loads((PROJECT / "clients" / "record" / "recording.ipynb").read_text())
    cells = ["".join(one["source"]) for one in notebook["cells"] if one["cell_type"] == "code"]
    names: dict[str, object] = {}
    for cell in cells:
        exec(re.sub(r'Path\("recordings/.*"\)', f"Path({str(whole.path)!r})", cell), names)
    figures = [plt.figure(number) for number in plt.get_fignums()]
    plt.close("all")

    lines = [[len(axis.lines) for axis in figure.axes] for figure in figures]
    assert [len(one) for one in lines] == [3, 2, 1]
    assert all(count > 0 for one in lines for count in one)
    assert len(names["strides"]) >= 5
