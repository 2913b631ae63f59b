"""A lock beside the ring says that a core starts, and holds up none."""

import fcntl

import pytest

from daemon.ipc import starting


def test_a_core_starts_until_it_says_that_it_has_begun_and_takes_nothing_from_another(tmp_path):
    runtime = tmp_path / "not" / "yet"
    assert starting.starting(runtime) is False
    for _ in range(2):  # also with the file of an earlier core
        with starting.said(runtime):
            with starting.said(runtime) as begun:
                assert starting.starting(runtime)
                begun()
            assert starting.starting(runtime)
        assert starting.starting(runtime) is False


@pytest.mark.timeout(10)
def test_a_reader_that_is_stopped_with_the_lock_holds_up_no_core(tmp_path):
    with (tmp_path / starting.STARTING_NAME).open("ab") as reader:
        fcntl.flock(reader, fcntl.LOCK_EX)

        with starting.said(tmp_path) as begun:
            begun()


def test_a_directory_that_cannot_be_used_is_the_error_of_those_who_need_it(tmp_path):
    (tmp_path / "file").touch()

    with starting.said(tmp_path / "file") as begun:
        assert not starting.starting(tmp_path / "file")
        begun()
