"""The file that keeps poses and proofs across restarts."""

import re

import msgspec
import pytest
from gaitd_names import Finding
from msgspec.structs import replace
from power_cuts import check
from traced_calls import mark

from daemon.core.modes.persistent_state import (
    UNREADABLE,
    PersistentState,
    SignProof,
    StoredAxis,
    StoredVerdict,
)
from daemon.core.runtime.state_file import StateFile
from daemon.ipc.state_file import NAME, SIZE
from daemon.recorder.state_file_sync import StateFileSync

PROOF = SignProof(5, 305_000_005, 1, 100.0, None, 1024, 0.036, -0.036, 1)
NOTES = PersistentState(axes={"right/hip": StoredAxis(0.25, 7, PROOF)})


def test_what_is_written_is_found_by_the_next_start(tmp_path):
    state_file = StateFile(tmp_path)
    assert state_file.persistent == PersistentState()
    state_file.write(NOTES, 0)
    state_file.close()

    assert StateFile(tmp_path).persistent == NOTES
    with pytest.raises(ValueError, match="closed"):
        state_file.write(NOTES, 0)


@pytest.mark.parametrize("before", [None, b"", b"{}"])
def test_the_file_has_all_its_room_before_the_first_note(tmp_path, before):
    if before is not None:
        (tmp_path / NAME).write_bytes(before)

    StateFile(tmp_path)

    verdicts = (tmp_path / NAME).stat()
    assert verdicts.st_size == SIZE
    assert verdicts.st_blocks * 512 >= SIZE


def test_what_is_written_survives_a_process_that_never_closes_it(tmp_path):
    StateFile(tmp_path).write(NOTES, 0)

    assert StateFile(tmp_path).persistent == NOTES


def test_a_shorter_note_leaves_nothing_of_a_longer_one(tmp_path):
    state_file = StateFile(tmp_path)
    state_file.write(NOTES, 0)
    state_file.write(PersistentState(), 0)
    state_file.close()

    assert StateFile(tmp_path).persistent == PersistentState()
    assert (tmp_path / NAME).stat().st_size == 2 * 8192


@pytest.mark.parametrize(
    "text",
    [b"{", b'{"axes": 3}', b'{"axes": {}, "format": "gaitd.axes.v2"}', b"\xff\xfe", b"[1]" * 3000],
    ids=["cut", "wrong type", "another version", "no text", "too long"],
)
def test_a_file_that_cannot_be_read_is_damaged_and_not_missing(tmp_path, text):
    (tmp_path / NAME).write_bytes(text)

    persistent = StateFile(tmp_path).persistent

    assert persistent.damaged
    assert persistent.latched is not None


@pytest.mark.parametrize("size", [0, 100, SIZE])
def test_a_file_that_a_crash_left_empty_is_no_clean_one(tmp_path, size):
    (tmp_path / NAME).write_bytes(b"\0" * size)

    assert StateFile(tmp_path).persistent == UNREADABLE


def test_a_new_file_can_be_read_before_anything_has_happened(tmp_path):
    StateFile(tmp_path)

    assert StateFile(tmp_path).persistent == PersistentState()


def test_the_longest_notes_of_two_legs_fit_the_page(tmp_path):
    axes = {
        f"right/axis{number}": StoredAxis(-0.123456789012345, 10**18, PROOF) for number in (1, 2)
    }
    axes |= {
        f"left/axis{number}": StoredAxis(-0.123456789012345, 10**18, PROOF) for number in (1, 2)
    }
    finding = max(Finding, key=len)
    long = StoredVerdict(
        "S1", "last_end_unknown", "right/slide", -1e-300, 1e-300, finding, "d" * 120, 10**18
    )

    persistent = PersistentState(axes=axes, latched=long)
    StateFile(tmp_path).write(persistent, 0)

    assert StateFile(tmp_path).persistent == persistent


def test_a_state_that_does_not_fit_is_a_bug_of_ours_and_changes_nothing(tmp_path):
    state_file = StateFile(tmp_path)
    state_file.write(NOTES, 0)
    long = StoredVerdict("S1", "bus_off", said="x" * 8192)

    with pytest.raises(ValueError, match=r"axis notes of \d+ bytes do not fit 8192"):
        state_file.write(PersistentState(latched=long), 0)
    assert StateFile(tmp_path).persistent == NOTES


def test_a_page_is_used_up_to_its_last_line_break(tmp_path):
    state_file, refused = StateFile(tmp_path), []
    for size in range(7801, 8192):
        persistent = PersistentState(latched=StoredVerdict("S1", "bus_off", said="x" * size))
        try:
            state_file.write(persistent, 0)
        except ValueError as error:
            refused += map(int, re.findall(r"of (\d+) bytes", str(error)))

    assert min(refused) == 8192


@pytest.mark.parametrize(("name", "change"), [("crc32", -1), ("crc32", 1), ("another", 0)])
def test_a_page_with_a_wrong_checksum_or_another_field_is_torn(tmp_path, name, change):
    StateFile(tmp_path).close()
    data = (tmp_path / NAME).read_bytes()
    page = msgspec.json.decode(data[8192:])
    torn = msgspec.json.encode(page | {name: page.get(name, 0) + change}).ljust(8192)
    (tmp_path / NAME).write_bytes(torn * 2)

    assert StateFile(tmp_path).persistent == UNREADABLE


@pytest.mark.parametrize("version", ["a", "z"])
def test_a_page_of_another_version_is_not_read(tmp_path, version):
    StateFile(tmp_path).write(replace(NOTES, format=version), 0)

    persistent = StateFile(tmp_path).persistent

    assert (persistent.axes, persistent.damaged) == ({}, True)


@pytest.mark.parametrize(
    ("writes_s", "kept"),
    [
        *(((0.0,), {0, 1}), ((0.0, 1.0), {1, 2}), ((0.0, 0.999_999_999), {0, 2})),
        *(((0.0, 1.0, 2.0), {2, 3}), ((1.0, 2.5), {1, 2}), ((1.0, 1.5), {0, 2})),
    ],
)
def test_a_page_is_left_alone_until_the_newest_one_has_rested(tmp_path, writes_s, kept):
    state_file = StateFile(tmp_path)
    for number, time_s in enumerate(writes_s, 1):
        state_file.write(PersistentState(utc_newest_ns=number), int(time_s * 1e9))
    data = (tmp_path / NAME).read_bytes()

    pages = (msgspec.json.decode(data[begin : begin + 8192]) for begin in (0, 8192))
    assert {page["state"].get("utc_newest_ns", 0) for page in pages} == kept


# --- power cuts -----------------------------------------------------------------------------------

STOP = StoredVerdict("S1", "hand_switch_open", said="the hand switch was opened", utc_ns=10**18)
HISTORY = (
    # Time of a write in s, its stop, and whether the gateway's thread syncs after it.
    (0.0, None, False),
    (0.1, None, True),
    (1.5, STOP, False),
    (1.6, STOP, True),
    (3.0, STOP, False),
    (3.1, None, False),
    (3.2, None, True),
    (4.5, None, False),
    (4.6, STOP, False),
    (4.7, STOP, True),
    (4.8, STOP, False),
)


def state_of(step: int) -> PersistentState:
    """All states have the same length, so a mix of their sectors can be JSON."""
    axes = {
        name: StoredAxis((step + 1) / 64, 10**18 + step, replace(PROOF, utc_ns=10**18 + step))
        for name in ("right/hip", "right/slide", "left/hip", "left/slide")
    }
    return PersistentState(axes=axes, latched=HISTORY[step][1], utc_newest_ns=10**18 + step)


def test_after_a_power_cut_the_notes_are_old_or_new_and_no_stop_is_lost(tmp_path):
    states = [PersistentState(), *map(state_of, range(len(HISTORY)))]

    def scenario():
        state_file = StateFile(tmp_path / "state")
        mark("made")
        disk = StateFileSync(state_file.path)
        disk.close()
        mark("synced")
        for step, (time_s, _, is_synced) in enumerate(HISTORY):
            state_file.write(states[step + 1], int(time_s * 1e9))
            mark("wrote")
            if is_synced:
                disk.sync()
                mark("synced")
        state_file.close()
        mark("synced")

    seen = {"new": 0, "older": 0, "torn": 0, "unreadable": 0}

    def recover(marks):
        persistent = StateFile(tmp_path / "state").persistent
        assert StateFile(tmp_path / "state").persistent == persistent
        begun = marks.count("wrote") + 1
        if persistent == UNREADABLE:
            seen["unreadable"] += 1
            assert not marks
            return
        number = [one.axes for one in states].index(persistent.axes)
        if persistent.damaged:
            seen["torn"] += 1
            assert persistent.latched is not None
            return
        synced = [at for at, word in enumerate(marks) if word == "synced"]
        durable = marks[: synced[-1]].count("wrote") if synced else 0
        assert persistent == states[number]
        assert durable <= number <= begun
        seen["new" if number >= begun - 1 else "older"] += 1

    check(tmp_path, scenario, recover, random_count=8)
    assert all(seen.values()), seen
