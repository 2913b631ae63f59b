"""`gaitd scan` and `gaitd drive` as people type them: on virtual drives in simulated time."""

import json
import sys

import pytest
from bench_bus import Machine
from command_line import gaitd

ELSEWHERE = ("drives/slide_epos4.toml", "node_id = 6", "node_id = 9")
ANOTHER = ("drives/hip_epos4.toml", "0x61500000", "0x65520000")


@pytest.fixture
def machine_of(tmp_path, monkeypatch):
    def made(*changes):
        machine = Machine(tmp_path, *changes)
        for program in ("scan", "drive"):
            monkeypatch.setattr(f"gaitd.{program}.opened", machine.opened)
        return machine

    return made


@pytest.fixture
def machine(machine_of):
    return machine_of()


def told(machine, name, *words):
    return ("drive", name, *words, "--config", machine.config)


# --- scan -----------------------------------------------------------------------------------------


def test_scan_lists_the_drives_of_the_file_and_ends_with_0(machine):
    ended = gaitd("scan", "--config", machine.config)

    assert ended.code == 0
    assert "right/hip" in ended.out
    assert "maxon (FBh)" in ended.out
    assert "none: right/hip, right/slide are there and are what their files describe" in ended.out
    assert ended.err == ""


@pytest.mark.usefixtures("machine")
def test_scan_without_a_file_needs_the_three_words_of_a_bus():
    words = ("--interface", "virtual", "--channel", "bench")

    missing = gaitd("scan", *words)
    whole = gaitd("scan", *words, "--bitrate", 1_000_000, "--json")

    assert missing.code == 2
    assert "--bitrate = (missing)" in missing.err
    found = json.loads(whole.out)
    assert [s["node_id"] for s in found["stations"]] == [5, 6]
    assert [s["serial"] for s in found["stations"]] == [305_000_005, 305_000_006]
    assert found["wrong"] is False


def test_a_missing_and_another_drive_end_a_scan_with_3(machine_of):
    machine = machine_of(ELSEWHERE, ANOTHER)

    ended = gaitd("scan", "--config", machine.config, "--json")

    findings = json.loads(ended.out)["findings"]
    assert ended.code == 3
    assert [(f["kind"], f["drive"]) for f in findings] == [
        ("other_device", "right/hip"),
        ("missing", "right/slide"),
    ]


# --- drive ----------------------------------------------------------------------------------------


def test_a_name_that_no_drive_has_is_answered_with_those_that_there_are(machine):
    ended = gaitd(*told(machine, "left/hip", "dump"))

    assert ended.code == 2
    assert "right/hip (node 5), right/slide (node 6)" in ended.err


def test_a_dump_shows_name_value_and_meaning_and_json_has_the_same(machine):
    text = gaitd(*told(machine, "right/hip", "dump"))
    table = json.loads(gaitd(*told(machine, "5", "dump", "--json")).out)

    line = next(line for line in text.out.splitlines() if line.startswith("  6041h:00"))
    statusword = next(o for o in table["objects"] if (o["index"], o["sub"]) == (0x6041, 0))
    assert text.code == 0
    assert line.split()[1:] == ["Statusword", "33344", "8240h", "switch", "on", "disabled"]
    assert (statusword["value"], statusword["meaning"]) == (0x8240, "switch on disabled")
    assert table["drive"] == "right/hip"


def test_a_dump_in_a_file_is_equal_to_the_drive_until_something_is_written(machine, tmp_path):
    file = tmp_path / "slide.dcf"

    dumped = gaitd(*told(machine, "right/slide", "dump", "--output", file))
    equal = gaitd(*told(machine, "right/slide", "compare", "--with", file))
    machine.drives.write(0x6065, 0, 12345, 4, node_id=6)
    changed = gaitd(*told(machine, "right/slide", "compare", "--with", file))

    assert (dumped.code, equal.code, changed.code) == (0, 0, 1)
    assert str(file) in dumped.out
    assert "0 of " in equal.out
    (line,) = (line for line in changed.out.splitlines() if "6065h:00" in line)
    assert line.split("  ")[-1] == "as in slide.dcf"
    assert "12345 (00003039h)" in line


def test_compare_tells_what_bring_up_would_change_and_why(machine):
    ended = gaitd(*told(machine, "right/hip", "compare"))
    table = json.loads(gaitd(*told(machine, "right/hip", "compare", "--all", "--json")).out)
    with_eds = gaitd(*told(machine, "right/hip", "compare", "--eds"))

    assert ended.code == 1
    assert "its own heartbeat in ms" in ended.out
    assert "vendor of this axis" not in ended.out
    assert table["compared_count"] == len(table["objects"])
    assert {o["same"] for o in table["objects"]} == {True, False}
    assert with_eds.code == 1
    assert "EDS default" in with_eds.out


def test_a_drive_that_is_not_there_ends_with_3(machine_of):
    machine = machine_of(ELSEWHERE)

    compared = gaitd(*told(machine, "right/slide", "compare"))
    stored = gaitd(*told(machine, "right/slide", "store", "--yes"))

    assert (compared.code, stored.code) == (3, 3)
    assert "drive right/slide: no answer from node 9" in compared.err
    assert "drive right/slide: no answer for 1000h:00" in stored.err
    assert (compared.err + stored.err).count("\n") == 2


def test_a_drive_that_another_master_stopped_is_told_from_one_that_is_gone(machine):
    machine.drives.write(0x1017, 0, 50, 2)  # the heartbeat tells the state
    machine.drives.nmt(2)

    ended = gaitd(*told(machine, "right/hip", "dump"))

    assert ended.code == 3
    assert "node 5 is stopped: no SDO in this state" in ended.err


def test_nothing_is_stored_without_a_terminal_or_yes(machine):
    ended = gaitd(*told(machine, "right/hip", "store"))

    assert ended.code == 2
    assert "--yes" in ended.err


def test_nothing_is_stored_by_whoever_says_no(machine, monkeypatch):
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("typer.confirm", lambda *_, **__: False)

    ended = gaitd(*told(machine, "right/hip", "store"))

    assert ended.code == 1
    assert "nothing was done" in ended.out


def test_store_and_restore_say_what_they_do_and_what_is_still_to_be_done(machine):
    stored = gaitd(*told(machine, "right/hip", "store", "--yes"))
    restored = gaitd(*told(machine, "right/hip", "restore", "--yes"))
    reset = gaitd(*told(machine, "right/hip", "restore", "--yes", "--reset"))

    assert (stored.code, restored.code, reset.code) == (0, 0, 0)
    assert "overwrites what it has stored" in stored.out
    assert stored.out.endswith("right/hip (node 5): stored\n")
    assert "at the next power-on or NMT reset node" in restored.out
    assert "has its maker's defaults now" in reset.out


def test_another_drive_than_the_file_describes_is_not_stored(machine_of):
    ended = gaitd(*told(machine_of(ANOTHER), "right/hip", "store", "--yes"))

    assert ended.code == 3
    assert "1018h:02" in ended.err


def test_another_client_s_transfers_keep_it_from_dumping(machine):
    machine.send_later(0x605, bytes.fromhex("4000100000000000"))

    ended = gaitd(*told(machine, "right/hip", "dump"))

    assert ended.code == 3
    assert "another client reads or writes its objects now" in ended.err
