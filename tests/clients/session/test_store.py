"""The history survives a power cut at any byte, a killed writer and files that are none."""

import os
import signal
import sqlite3

import pytest
from gaitd_session.export import ExportError, export
from gaitd_session.store import (
    APPLICATION_ID,
    EXPORTED,
    INTERRUPTED,
    MIGRATIONS,
    BlockRow,
    EndRow,
    GoalRow,
    InterruptionRow,
    MarkRow,
    SelfTestRow,
    SessionRow,
    Store,
    StoreError,
    StrideRow,
    open_history,
)
from power_cuts import check
from traced_calls import mark

PROFILE, OTHER = "7f3k9m2q", "zzzzzzzz"
BATCH_COUNT = 8


def batch(number):
    """What some seconds of a session write: one stride, and the block as far as it was walked."""
    share = 0.3 + number / 100
    return [
        StrideRow(1, "right", 1000 + number, 2.0, share, 0.02, 5.0, -1.0, True),
        BlockRow(1, "warm_up", 0.3, 0.5, 60.0, 2.0 * number),
        GoalRow(1, "right", 0.3, share),
    ]


def begun(file, profile=PROFILE):
    store = Store(file, is_writer=True)
    store.write([SessionRow(profile, "trainer", 1000), SelfTestRow(profile, 900)])
    return store


def state_of(store):
    """Strides, time walked, goal: equal to those of a whole number of batches, or it is torn."""
    (summary,) = store.summaries(PROFILE) or [None]
    if summary is None:
        return 0
    count = summary.stride_count
    assert summary.walked_s == pytest.approx(2.0 * (count - 1) if count else 0.0)
    expected = {"right": pytest.approx(0.3 + (count - 1) / 100)} if count else {}
    assert store.middles(PROFILE) == expected
    return count


def test_a_power_cut_at_any_length_of_the_log_leaves_whole_batches_and_all_that_were_synced(
    tmp_path,
):
    store = begun(tmp_path / "a.sqlite")
    log = tmp_path / "a.sqlite-wal"
    synced = [log.stat().st_size]
    for number in range(BATCH_COUNT):
        store.write(batch(number))
        synced.append(log.stat().st_size)
    database, written = (tmp_path / "a.sqlite").read_bytes(), log.read_bytes()
    store.close()
    cut = tmp_path / "cut.sqlite"
    counts = []
    for length in sorted({*range(synced[0], len(written), 2048), *synced}):
        cut.write_bytes(database)
        cut.with_name("cut.sqlite-wal").write_bytes(written[:length])
        cut.with_name("cut.sqlite-shm").unlink(missing_ok=True)
        history = open_history(cut)
        assert history.trouble == ""
        counts.append(state_of(history.store))
        # What was committed before the cut is there.
        assert counts[-1] == sum(length >= size for size in synced) - 1
        (summary,) = history.store.summaries(PROFILE)
        assert summary.end == INTERRUPTED
        history.store.close()

    assert counts[0] == 0
    assert counts[-1] == BATCH_COUNT
    assert counts == sorted(counts)


def test_a_power_cut_at_any_call_of_the_writer_loses_no_batch_that_it_acknowledged(tmp_path):
    """From the first file on, through the end of a session, and the emptying of the log."""
    file = tmp_path / "folder" / "a.sqlite"
    file.parent.mkdir()

    def scenario():
        with begun(file) as store:
            mark("begun")
            for number in range(3):
                store.write(batch(number))
                mark("batch")
            store.write([EndRow(9000, "complete")])
            mark("end")

    def recover(marks):
        history = open_history(file)
        assert (history.store is not None, history.trouble) == (True, "")
        with history.store as store:
            assert state_of(store) >= marks.count("batch")
            ends = [one.end for one in store.summaries(PROFILE)]
            assert ends or "begun" not in marks
            assert set(ends) <= {"complete", INTERRUPTED}
            assert "end" not in marks or ends == ["complete"]

    check(tmp_path / "folder", scenario, recover, random_count=1)


def test_a_killed_writer_has_kept_every_batch_that_it_acknowledged(tmp_path):
    file = tmp_path / "a.sqlite"
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            store = begun(file)
            for number in range(1_000_000):
                store.write(batch(number))
                os.write(writer, b".")
        finally:
            os._exit(1)
    acknowledged = 0
    while acknowledged < 20:
        acknowledged += len(os.read(reader, 4096))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(writer)
    while more := os.read(reader, 4096):
        acknowledged += len(more)
    os.close(reader)

    with Store(file, is_writer=True) as store:
        assert acknowledged <= state_of(store) <= acknowledged + 1


def test_a_batch_that_fails_is_not_there_in_part_and_the_next_one_is(tmp_path):
    with begun(tmp_path / "a.sqlite") as store:
        store.write(batch(0))
        with pytest.raises(StoreError, match="check the disk"):
            store.write([*batch(1), BlockRow(2, "walking", None, 0.5, 60.0, 0.0)])
        assert state_of(store) == 1
        store.write(batch(1))

        assert state_of(store) == 2
        store.write([EndRow(2000, "complete")])
        with pytest.raises(StoreError, match="NOT NULL"):
            store.write(batch(2))
        assert state_of(store) == 2


def write_text(file):
    file.write_text("this is no database, but a diary of more than a hundred bytes " * 4)


def write_foreign(file):
    with sqlite3.connect(file) as database:
        database.execute("CREATE TABLE diary (day TEXT)")
    database.close()


def write_later(file):
    begun(file).close()
    with sqlite3.connect(file) as database:
        database.execute("PRAGMA user_version = 99")
    database.close()


def write_torn(file):
    store = begun(file)
    store.write([row for number in range(200) for row in batch(number)])
    store.close()
    data = bytearray(file.read_bytes())
    data[8192:16384] = b"\xa5" * 8192
    file.write_bytes(data)


@pytest.mark.parametrize(
    ("write", "reason"),
    [
        (write_text, "no SQLite file"),
        (write_foreign, "another program"),
        (write_later, "version 99, this program reads up to 2"),
        (write_torn, "damaged"),
    ],
)
def test_an_unusable_file_is_kept_aside_and_a_new_history_begins(tmp_path, write, reason):
    file = tmp_path / "a.sqlite"
    write(file)
    before = file.read_bytes()
    with pytest.raises(StoreError, match=reason):
        Store(file, is_writer=False)

    history = open_history(file)

    assert reason in history.trouble
    assert (tmp_path / "a.sqlite.aside-1").read_bytes() == before
    history.store.write([SessionRow(PROFILE, "trainer", 1000)])
    assert state_of(history.store) == 0
    history.store.close()


def test_a_second_writer_and_a_folder_that_is_not_there_leave_a_session_without_history(tmp_path):
    with begun(tmp_path / "a.sqlite") as store:
        second = open_history(tmp_path / "a.sqlite")
        assert second.store is None
        assert "another session writes to it" in second.trouble
        store.write(batch(0))
    nowhere = open_history(tmp_path / "none" / "a.sqlite")

    assert nowhere.store is None
    assert "No such file" in nowhere.trouble


def test_strides_of_the_oldest_sessions_make_room_and_their_sessions_stay(tmp_path, monkeypatch):
    file = tmp_path / "history.sqlite"
    per_session = 2000

    def play(store, number):
        strides = [batch(number)[0]._replace(end_utc_ns=n) for n in range(per_session)]
        store.write([*strides, *batch(number)[1:]])

    for number in range(6):
        with begun(file) as store:
            play(store, number)
    before = file.stat().st_size

    monkeypatch.setattr("gaitd_session.store.STRIDES_BYTES_MAX", before * 6 // 10)
    with begun(file) as store:  # one program for many sessions, as the patient's page
        kept = store.summaries(PROFILE)
        play(store, 6)
        for number in (7, 8):
            store.write([SessionRow(PROFILE, "trainer", 1000)])
            play(store, number)

    assert [one.stride_count for one in kept] == [0] * 3 + [per_session] * 3 + [0]
    assert all(one.walked_s == 2.0 * n for n, one in enumerate(kept[:6]))
    assert file.stat().st_size <= before
    monkeypatch.setattr("gaitd_session.store.STRIDES_BYTES_MAX", 0)
    monkeypatch.setattr("gaitd_session.store.TRIMMED_SESSIONS_MAX", 2)
    with Store(file, is_writer=True) as store:
        held = len(store.strides(PROFILE))
        assert held >= 3 * per_session
        store.write([SessionRow(PROFILE, "trainer", 1000)])
        assert len(store.strides(PROFILE)) == held - 2 * per_session


def test_a_mark_is_of_the_session_that_goes_on_or_was_the_last_or_comes_next(tmp_path):
    def mark(profile, utc_ns, *, is_before=False):
        return MarkRow(profile, utc_ns, f"remark at {utc_ns}", is_before)

    with Store(tmp_path / "a.sqlite", is_writer=True) as store:
        store.write([mark(PROFILE, 1, is_before=True), mark(OTHER, 2, is_before=True)])
        store.write([SessionRow(PROFILE, "trainer", 3), mark(PROFILE, 4), EndRow(5, "complete")])
        store.write([mark(PROFILE, 6), mark(PROFILE, 6)])
        store.write([SessionRow(OTHER, "trainer", 7), mark(OTHER, 8)])
        times = [
            [one.utc_ns for one in store.marks(who)[n]] for n, who in ((1, PROFILE), (2, OTHER))
        ]
        store.erase(PROFILE)
        left = (store.marks(PROFILE), [one.said for one in store.marks(OTHER)[2]])

    assert times == [[1, 4, 6], [2, 8]]
    assert left == ({}, ["remark at 2", "remark at 8"])


def test_a_reader_of_an_earlier_file_says_who_brings_it_up_to_date(tmp_path):
    file = tmp_path / "a.sqlite"
    with sqlite3.connect(file) as database:
        for statement in MIGRATIONS[0]:
            database.execute(statement)
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute("PRAGMA user_version = 1")
        database.execute(
            "INSERT INTO session VALUES (1, ?, 'trainer', 1000, 2000, 'ended')", [PROFILE]
        )
    database.close()

    with pytest.raises(StoreError, match="patient's page"):
        Store(file, is_writer=False)
    Store(file, is_writer=True).close()
    with Store(file, is_writer=False) as store:
        assert (len(store.summaries(PROFILE)), store.marks(PROFILE)) == (1, {})


def test_erase_leaves_no_trace_of_a_profile_in_any_file_and_others_whole(tmp_path):
    file = tmp_path / "a.sqlite"
    with begun(file, OTHER) as store:
        store.write([*batch(0), EndRow(2000, "complete")])
        store.write([SessionRow(PROFILE, "trainer", 3000), SelfTestRow(PROFILE, 2900), *batch(0)])
        store.write([InterruptionRow(3100, "stopped", f"of {PROFILE}")])
        assert any(PROFILE.encode() in one.read_bytes() for one in tmp_path.iterdir())

        assert store.erase(PROFILE) == 1

        assert not any(PROFILE.encode() in one.read_bytes() for one in tmp_path.iterdir())
        assert store.summaries(PROFILE) == []
        assert store.self_test_utc_ns(PROFILE) == 0
        assert len(store.strides(OTHER)) == 1
        assert store.self_test_utc_ns(OTHER) == 900


def test_erase_says_that_a_reader_keeps_the_log(tmp_path):
    file = tmp_path / "a.sqlite"
    with begun(file) as store:
        reader = sqlite3.connect(file)
        reader.execute("BEGIN")
        reader.execute("SELECT * FROM session").fetchall()
        store._database.execute("PRAGMA busy_timeout = 50")
        with pytest.raises(StoreError, match=r"another program reads the file|locked"):
            store.erase(PROFILE)
        reader.close()

        store.erase(PROFILE)


def test_parquet_is_refused_with_its_reason_where_pyarrow_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(ExportError, match=r"pip install 'gaitd-session\[parquet\]'"):
        export([], tmp_path / "a.parquet")
    with pytest.raises(ExportError, match=r"must be \.csv or \.parquet"):
        export([], tmp_path / "a.xlsx")


def test_a_stride_is_exported_with_its_block_and_goal(tmp_path):
    with begun(tmp_path / "a.sqlite") as store:
        store.write(batch(0))
        (stride,) = store.strides(PROFILE)

    shown = dict(zip(EXPORTED, stride, strict=True))
    assert (shown["kind"], shown["cadence_hz"], shown["band_middle_ratio"]) == ("warm_up", 0.3, 0.3)


def test_the_targets_of_each_block_say_how_often_they_were_reached_and_whether_the_block_goes_on(
    tmp_path,
):
    half_width = 0.05
    with begun(tmp_path / "a.sqlite") as store:
        store.write([row for number in range(4) for row in batch(number)])  # shares 0.30 to 0.33
        store.write([StrideRow(1, "right", 2000, 2.0, 0.24, 0.02, 5.0, -1.0, True)])
        store.write([StrideRow(1, "right", 2001, 2.0, 0.9, 0.02, 5.0, -1.0, False)])
        store.write([GoalRow(1, "left", 0.2, 0.2)])
        left, right = store.goals(PROFILE, half_width)
        assert (right.session, right.block, right.leg) == (1, 1, "right")
        assert (right.middle_ratio, right.next_middle_ratio) == (0.3, pytest.approx(0.33))
        assert (right.reached_count, right.goes_on) == (4, True)
        assert (left.leg, left.reached_count) == ("left", 0)
        store.write([BlockRow(1, "warm_up", 0.3, 0.5, 60.0, 60.0)])
        assert not any(goal.goes_on for goal in store.goals(PROFILE, half_width))
        store.write([BlockRow(1, "warm_up", 0.3, 0.5, 60.0, 6.0), EndRow(3000, "ended")])
        assert not any(goal.goes_on for goal in store.goals(PROFILE, half_width))
        assert store.goals(OTHER, half_width) == []


def test_a_session_without_an_end_goes_on_only_while_its_program_is_alive(tmp_path):
    file = tmp_path / "a.sqlite"

    def read():
        with Store(file, is_writer=False) as store:
            (summary,), (goal,) = store.summaries(PROFILE), store.goals(PROFILE, 0.05)
        return summary.end, bool(goal.goes_on)

    with begun(file) as store:
        store.write(batch(1))
        assert read() == ("", True)
    assert read() == (INTERRUPTED, False)
    file.with_name("a.sqlite.lock").unlink()
    assert read() == (INTERRUPTED, False)
