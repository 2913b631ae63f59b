"""`gaitd blackbox` on files of the black box and a request log, without a service."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from command_line import gaitd
from gaitd_names import Cause, Mode, StopCategory
from gaitd_texts import Reader, catalogue
from mcap.reader import make_reader
from msgspec.structs import replace
from records import HEADER, cut_out, record

from analysis.recording import read_csv
from analysis.replay import read
from daemon.ipc.record import Verdict
from daemon.ipc.ring_clip import FOLDER
from daemon.ipc.transport import Kept
from daemon.recorder.audit_file import NAME
from daemon.recorder.clip_store import ClipStore
from daemon.report_messages import judgement

TEXTS = catalogue(Reader.OPERATOR, "en")
OPEN = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN, "right/hip", said="let go")
ROBOT = Path(__file__).parents[2] / "configs" / "robot.toml"


def records():
    for seq in range(1, 301):
        made = record(seq)
        (leg,) = made.legs
        hip = replace(leg.hip, measured_position=0.2 + 0.1 * float(np.sin(seq / 60)))
        stopped = {"mode": Mode.STOPPING, "verdict": OPEN} if seq > 200 else {}
        yield replace(made, legs=(replace(leg, hip=hip),), **stopped)


@pytest.fixture
def state(tmp_path):
    """A state directory with one stop and a log of two requests."""
    import tomllib

    header = replace(HEADER, robot=tomllib.loads(ROBOT.read_text()))
    at_ns = record(201).sync_utc_ns
    kept = Kept("hand_switch_open", "right/hip", 201, at_ns, 1, 300, True, ("sto_active",))
    ClipStore(tmp_path / FOLDER).write(header, kept, cut_out(records()))
    with (tmp_path / NAME).open("wb") as file:
        for name in ("enable", "stop"):
            said = {"utc": "2026-01-01T00:00:00.000000Z", "kind": "answered", "name": name}
            said |= {"client": "display", "payload": {"client": "display"}, "outcome": "done"}
            file.write(msgspec.json.encode(said) + b"\n")
    return tmp_path


@pytest.fixture
def stop(state):
    (path,) = (state / FOLDER).iterdir()
    return path


def test_the_list_names_time_cause_drive_seconds_and_size(state, stop):
    shown = gaitd("blackbox", "--state", state)

    assert shown.code == 0
    for words in ("hand_switch_open, sto_active", "right/hip", "2.0 s", "1.0 s", "MB", stop.name):
        assert words in shown.out


def test_a_program_gets_the_list_as_json(state, stop):
    (one,) = json.loads(gaitd("blackbox", "--state", state, "--json").out)

    assert one["file"] == str(stop)
    assert one["size_bytes"] == stop.stat().st_size
    assert one["kept"]["stop_seq"] == 201


def test_a_damaged_file_is_in_the_list_and_hides_no_other(state, stop):
    (state / FOLDER / "0.ring").write_bytes(b"rubbish")

    shown = gaitd("blackbox", "--state", state)

    assert shown.code == 0
    assert "too few" in shown.out
    assert stop.name in shown.out


def test_show_tells_the_story_of_a_stop(stop):
    shown = gaitd("blackbox", "show", stop)

    assert shown.code == 0
    for words in (
        "hand_switch_open (right/hip), then sto_active",
        TEXTS.verdict(judgement(OPEN)),
        TEXTS.remedy("hand_switch_open"),
        "2.00 s before it, 0.99 s after; 300 records",
        "+0.00  stopping  S1 hand_switch_open (right/hip)",
        "operation enabled",
        TEXTS.report("mode_changed", None, {"mode_before": "gait", "mode": "stopping"}, ""),
    ):
        assert words in shown.out


def test_the_exported_csv_is_the_recording_bit_for_bit(stop, tmp_path):
    out = tmp_path / "out.csv"

    assert gaitd("blackbox", "show", stop, "--csv", out).code == 0

    ours, theirs = read_csv(out), read(stop).recording
    for name in ("time_s", "position", "effort"):
        assert getattr(ours, name).tobytes() == getattr(theirs, name).tobytes()
    assert out.read_text().splitlines()[1].endswith("gait,NONE,none")


def test_an_exported_recording_has_what_the_ring_holds(stop, tmp_path):
    folder = tmp_path / "made"

    ran = gaitd("blackbox", "show", stop, "--recording", folder)

    assert ran.code == 0, ran.err
    ours, theirs = read(folder), read(stop)
    for name in ("time_s", "position", "effort"):
        assert getattr(ours.recording, name).tobytes() == getattr(theirs.recording, name).tobytes()
    assert ours.caller_bits.tolist() == theirs.caller_bits.tolist()
    assert ours.robot == theirs.robot
    with (folder / "messages.mcap").open("rb") as file:
        reader = make_reader(file)
        metadata = {one.name: one.metadata for one in reader.iter_metadata()}
        topics = [channel.topic for _, channel, _ in reader.iter_messages()]
    (kept,) = json.loads(metadata["gaitd.end"]["stops"])
    assert (kept["cause"], kept["drive"]) == ("hand_switch_open", "right/hip")
    assert kept["utc_ns"] == record(201).sync_utc_ns
    assert topics.count("/right/activity") == 300
    again = gaitd("blackbox", "show", stop, "--recording", folder)
    assert (again.code, "does not exist yet" in again.err) == (2, True)


def test_the_picture_is_drawn(stop, tmp_path):
    out = tmp_path / "out.png"

    assert gaitd("blackbox", "show", stop, "--plot", out).code == 0

    assert out.read_bytes().startswith(b"\x89PNG")


def test_replay_says_what_the_file_is(stop, tmp_path):
    shown = gaitd("replay", stop, "--output", tmp_path / "out.csv")

    assert shown.code == 0, shown.err
    assert "core boot" in shown.out
    assert "cause        hand_switch_open" in shown.out
    assert "stopped      2023-11-14 22:13:22.010 UTC" in shown.out


@pytest.mark.parametrize(
    ("refusal", "told"),
    [
        (
            {"code": "lease_taken", "subject": None, "values": {"holder": "law"}, "said": ""},
            "refused: law holds the lease",
        ),
        ("of_another_version", "refused: of_another_version"),
    ],
)
def test_the_log_tells_why_a_request_was_refused(state, refusal, told):
    line = {"utc": "2026-01-01T00:00:00.000000Z", "kind": "answered", "name": "acquire"}
    with (state / NAME).open("ab") as file:
        file.write(msgspec.json.encode(line | {"outcome": "refused", "refusal": refusal}) + b"\n")

    assert told in gaitd("blackbox", "requests", "--state", state).out


def test_the_log_is_shown_and_a_line_that_a_power_cut_tore(state):
    with (state / NAME).open("ab") as file:
        file.write(b'{"utc": "2026-01-01T00:0')

    shown = gaitd("blackbox", "requests", "--state", state)

    assert shown.code == 0
    assert "display" in shown.out
    assert "the line cannot be read" in shown.out


def test_a_ring_of_an_older_layout_is_refused_by_name(state, stop):
    older = stop.with_name("older.ring")
    older.write_bytes(b"GAITDRB1" + stop.read_bytes()[8:])

    for command in (("blackbox", "show"), ("replay",)):
        refused = gaitd(*command, older)
        assert refused.code == 2
        assert f"{older}: begins with b'GAITDRB1', a ring of records with" in refused.err
    listed = gaitd("blackbox", "--state", state)
    assert "begins with b'GAITDRB1'" in listed.out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["blackbox"], "--config FILE or --state DIRECTORY"),
        (["blackbox", "show"], "show needs a FILE"),
        (["blackbox", "show", "nowhere.ring"], "nowhere.ring: No such file"),
        (["blackbox", "show", ROBOT], "robot.toml"),
    ],
)
def test_what_cannot_be_done_is_refused_with_2_and_why(words, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    refused = gaitd(*words)

    assert refused.code == 2
    assert said in refused.err


def test_a_leg_that_is_not_there_and_a_file_that_is_the_recording_are_refused(stop):
    assert "only right" in gaitd("blackbox", "show", stop, "--leg", "left").err
    assert "is the recording itself" in gaitd("blackbox", "show", stop, "--csv", stop).err
