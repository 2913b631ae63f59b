"""The file that keeps poses and proofs across restarts."""

import pytest

from daemon.core.modes.persistent_state import (
    UNREADABLE,
    PersistentState,
    SignProof,
    StoredAxis,
    StoredVerdict,
)
from daemon.core.runtime.state_file import StateFile
from daemon.ipc.state_file import NAME, SIZE

PROOF = SignProof(5, 305_000_005, 1, 100.0, None, 1024, 0.036, -0.036, 1)
NOTES = PersistentState(axes={"right/hip": StoredAxis(0.25, 7, PROOF)})


def test_what_is_written_is_found_by_the_next_start(tmp_path):
    state_file = StateFile(tmp_path)
    assert state_file.persistent == PersistentState()
    state_file.write(NOTES)
    state_file.close()

    assert StateFile(tmp_path).persistent == NOTES


@pytest.mark.parametrize("before", [None, b"", b"{}"])
def test_the_file_has_all_its_room_before_the_first_note(tmp_path, before):
    if before is not None:
        (tmp_path / NAME).write_bytes(before)

    StateFile(tmp_path)

    verdicts = (tmp_path / NAME).stat()
    assert verdicts.st_size == SIZE
    assert verdicts.st_blocks * 512 >= SIZE


def test_what_is_written_survives_a_process_that_never_closes_it(tmp_path):
    StateFile(tmp_path).write(NOTES)

    assert StateFile(tmp_path).persistent == NOTES


def test_a_shorter_note_leaves_nothing_of_a_longer_one(tmp_path):
    state_file = StateFile(tmp_path)
    state_file.write(NOTES)
    state_file.write(PersistentState())
    state_file.close()

    assert StateFile(tmp_path).persistent == PersistentState()
    assert (tmp_path / NAME).stat().st_size == SIZE


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


def test_a_file_of_before_stops_were_noted_is_still_read(tmp_path):
    """As the service wrote it until then."""
    old = b'{"axes":{"right/hip":{"position_si":0.25,"noted_utc_ns":7,"proof":null}},'
    old += b'"format":"gaitd.axes.v1","damaged":false}'
    (tmp_path / NAME).write_bytes(old.ljust(SIZE - 1) + b"\n")

    persistent = StateFile(tmp_path).persistent

    assert persistent == PersistentState(axes={"right/hip": StoredAxis(0.25, 7)})
    assert persistent.latched is None


def test_the_longest_notes_of_two_legs_fit_the_page(tmp_path):
    axes = {
        f"right/axis{number}": StoredAxis(-0.123456789012345, 10**18, PROOF) for number in (1, 2)
    }
    axes |= {
        f"left/axis{number}": StoredAxis(-0.123456789012345, 10**18, PROOF) for number in (1, 2)
    }
    long = StoredVerdict(
        "S1", "LAST_END_UNKNOWN", "right/slide", -1e-300, 1e-300, "d" * 120, 10**18
    )

    persistent = PersistentState(axes=axes, latched=long)
    StateFile(tmp_path).write(persistent)

    assert StateFile(tmp_path).persistent == persistent
