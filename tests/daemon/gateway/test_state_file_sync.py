"""The core's notes are brought to the disk by the gateway, and only when they have changed."""

import mmap
import os
from unittest import mock

import pytest

from daemon.core.modes.persistent_state import PersistentState, StoredVerdict
from daemon.core.runtime.state_file import StateFile
from daemon.ipc.state_file import NAME
from daemon.recorder.state_file_sync import StateFileSync


@pytest.fixture
def disk(tmp_path):
    """Never by itself: the thread is ended, looks are asked for."""
    StateFile(tmp_path).write(PersistentState(), 0)
    disk = StateFileSync(tmp_path / NAME)
    disk.close()
    return disk


def test_what_the_core_wrote_through_its_mapping_is_synced_once(disk, tmp_path):
    state_file = StateFile(tmp_path)
    state_file.write(PersistentState(latched=StoredVerdict("S2", "stop_requested")), 0)

    with mock.patch.object(os, "fsync") as fsync:
        assert disk.sync()
        assert not disk.sync()

    assert fsync.call_count == 1


def test_a_sync_that_failed_is_tried_again(disk, tmp_path):
    StateFile(tmp_path).write(PersistentState(latched=StoredVerdict("S2", "stop_requested")), 0)

    broken = mock.patch.object(os, "fsync", side_effect=OSError(5, "input/output error"))
    with broken, pytest.raises(OSError, match="input/output"):
        disk.sync()
    assert disk.sync()


def test_a_file_that_is_not_there_yet_is_waited_for_and_the_end_brings_it_to_the_disk(tmp_path):
    disk = StateFileSync(tmp_path / NAME)
    StateFile(tmp_path).write(PersistentState(latched=StoredVerdict("S2", "stop_requested")), 0)

    disk.close()

    assert not disk.sync()


def test_a_disk_that_fails_is_said_once(disk, tmp_path, caplog):
    StateFile(tmp_path).write(PersistentState(latched=StoredVerdict("S2", "stop_requested")), 0)

    with mock.patch.object(os, "fsync", side_effect=OSError(5, "input/output error")):
        failing = StateFileSync(tmp_path / NAME)
        failing.close()

    said = [line for line in caplog.messages if "not on the disk" in line]
    assert len(said) == 1


def test_reading_a_page_sees_what_another_process_mapped(disk, tmp_path):
    """The seam between the two: a mapping and a file descriptor show the same page."""
    with (tmp_path / NAME).open("r+b") as file, mmap.mmap(file.fileno(), 0) as page:
        page[0:1] = b"["

        assert disk.sync()
