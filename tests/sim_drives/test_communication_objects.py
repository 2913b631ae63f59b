"""1000h to 1FFFh of each kind of drive: access, lengths, ranges, saving (CiA 301 7.5.2)."""

import struct

import pytest
from drive_bench import GENERIC, HIP, Bench, entries_of

ELMO = {"personality": "elmo_gold", "eds": "drives/elmo_gold.eds"}
SAVE = int.from_bytes(b"save", "little")
LOAD = int.from_bytes(b"load", "little")
NO_HIGHEST_SUBINDEX = {0x1003, *range(0x1600, 0x1604), *range(0x1A00, 0x1A04)}
"""Sub-index 0 counts what is used."""


def booted(kind):
    bench = Bench(hip=kind)
    bench.boot()
    return bench


def objects(kind):
    """What the EDS describes, as a client sees it."""
    eds = kind.get("eds", HIP["eds"])
    return [entry for entry in entries_of(eds, 5) if entry.address[0] < 0x2000]


@pytest.fixture(params=[{}, GENERIC, ELMO], ids=["epos4", "generic", "elmo"])
def kind(request):
    return request.param


def test_every_record_says_its_highest_subindex(kind):
    bench = booted(kind)
    highest = {}
    for entry in objects(kind):
        index, sub = entry.address
        highest[index] = max(highest.get(index, 0), sub)
    records = {i: sub for i, sub in highest.items() if sub and i not in NO_HIGHEST_SUBINDEX}

    assert {index: bench.read(index, 0) for index in records} == records


def test_what_is_read_only_cannot_be_written_and_what_is_not_there_neither(kind):
    bench = booted(kind)
    for entry in objects(kind):
        index, sub = entry.address
        if not entry.writable:
            assert bench.write(index, sub, 0, entry.size_bytes or 4) == 0x06010002, entry
    for index in {entry.address[0] for entry in objects(kind)}:
        assert bench.write(index, 200, 0, 1) == bench.read_abort(index, 200) == 0x06090011


def test_a_number_of_another_length_is_refused_before_anything_else(kind):
    bench = booted(kind)
    for entry in objects(kind):
        index, sub = entry.address
        for size in {1, 2, 3, 4} - {entry.size_bytes}:
            if entry.writable:
                code = 0x06070012 if size > entry.size_bytes else 0x06070013
                assert bench.write(index, sub, 0, size) == code, entry


def test_what_was_read_may_be_written_back(kind):
    bench = booted(kind)
    mappings = range(0x1600, 0x1C00)  # a valid PDO's mapping stands
    for entry in objects(kind):
        index, sub = entry.address
        if entry.writable and index not in {0x1010, 0x1011, *mappings}:
            assert bench.write(index, sub, bench.read(index, sub), entry.size_bytes) == 0, entry


@pytest.mark.parametrize(
    ("index", "sub", "value", "size", "code"),
    [
        (0x1003, 0, 1, 1, 0x06090030),
        (0x1003, 0, 9, 1, 0x06090030),
        (0x1003, 0, 255, 1, 0x06090030),
        (0x1014, 0, 0x4000_0085, 4, 0x06090030),
        (0x1014, 0, 0x2000_0085, 4, 0x06090030),
        (0x1014, 0, 0x0000_0885, 4, 0x06090030),
        (0x1014, 0, 0x0000_0086, 4, 0x06090030),
        (0x1014, 0, 0x8000_0601, 4, 0x06090030),
        (0x1014, 0, 0x8000_0086, 4, 0x06090030),
        (0x1014, 0, 0x8000_0085, 4, 0),
        (0x1016, 1, 0x0080_0064, 4, 0x06090031),
        (0x1016, 1, 0x007F_0064, 4, 0),
        (0x1016, 3, 0, 4, 0x06090011),
        (0x1017, 0, 65535, 2, 0),
        (0x1018, 4, 1, 4, 0x06010002),
        (0x1029, 1, 3, 1, 0x06090031),
        (0x1029, 2, 0, 1, 0x06090011),
        (0x100C, 0, 100, 2, 0x06020000),
        (0x100D, 0, 3, 1, 0x06020000),
        (0x1200, 1, 0x605, 4, 0x06010002),
        (0x1010, 1, LOAD, 4, 0x08000020),
        (0x1011, 1, SAVE, 4, 0x08000020),
        (0x1404, 1, 0, 4, 0x06020000),
        (0x1A00, 9, 0, 4, 0x06090011),
    ],
)
def test_each_object_refuses_what_it_cannot_be(index, sub, value, size, code):
    assert booted(GENERIC).write(index, sub, value, size) == code


@pytest.mark.parametrize(
    ("index", "sub", "value", "size", "code"),
    [
        (0x1003, 0, 1, 1, 0x06090030),
        (0x1003, 6, 0, 4, 0x06090011),
        (0x1005, 0, 0x80, 4, 0x06010002),
        (0x1009, 0, 0, 4, 0x06020000),
        (0x100A, 0, 0, 4, 0x06020000),
        (0x1014, 0, 0x8000_0085, 4, 0x06010002),
        (0x1015, 0, 100, 2, 0x06020000),
        (0x1016, 1, 0x0080_0064, 4, 0x06090030),
        (0x1016, 1, 0x007F_0064, 4, 0),
        (0x1016, 3, 0, 4, 0x06090011),
        (0x1020, 1, 0, 4, 0x06020000),
        (0x1029, 1, 3, 1, 0x06090030),
        (0x1029, 2, 0, 1, 0x06090011),
        (0x1400, 5, 0, 2, 0x06090011),
        (0x1800, 5, 0, 2, 0x06090011),
        (0x1800, 6, 0, 1, 0x06090011),
        (0x1A00, 13, 0, 4, 0x06090011),
        (0x2010, 0, 0, 4, 0x06020000),
        (0x607C, 0, 0, 4, 0x06020000),
        (0x6066, 0, 1, 2, 0x06090031),
    ],
)
def test_an_epos4_has_what_its_maker_says_and_no_more(bench, index, sub, value, size, code):
    assert bench.write(index, sub, value, size) == code


def test_an_emergency_that_was_moved_comes_under_its_new_identifier():
    bench = booted(GENERIC)
    bench.write(0x1014, 0, 0x8000_0085, 4)
    bench.world.command("emcy right/hip 0.01 0x2310")
    bench.run_ms(20)
    assert bench.frames(0x085) == []

    assert bench.write(0x1014, 0, 0x8000_00A5, 4) == 0
    assert bench.write(0x1014, 0, 0x0000_00A5, 4) == 0
    bench.world.command("emcy right/hip 0.01 0x4310")
    bench.run_ms(20)
    assert [struct.unpack("<H", data[:2])[0] for data in bench.frames(0x0A5)] == [0x4310]


def test_an_entry_of_the_error_history_that_is_not_there_cannot_be_read(kind):
    bench = booted(kind)
    assert bench.read(0x1003, 0) == 0
    assert bench.read_abort(0x1003, 1) == 0x08000024

    bench.world.command("emcy right/hip 0.01 0x2310")
    bench.run_ms(20)
    assert (bench.read(0x1003, 0), bench.read(0x1003, 1)) == (1, 0x2310)
    assert bench.read_abort(0x1003, 2) == 0x08000024


# --- what a sub-index of 1010h and 1011h speaks of ------------------------------------------------

HEARTBEAT, WINDOW = (0x1017, 0, 77, 2), (0x6065, 0, 77, 4)


def changed(bench):
    for address in (HEARTBEAT, WINDOW):
        assert bench.write(*address) == 0


def after_reset(bench):
    """Which of the two has kept its 77."""
    bench.nmt(0x81)
    bench.run_ms(400)
    return [bench.read(index, sub) == 77 for index, sub, *_ in (HEARTBEAT, WINDOW)]


@pytest.mark.parametrize(
    ("area", "kept"), [(1, [True, True]), (2, [True, False]), (3, [False, True])]
)
def test_a_plain_drive_saves_what_was_asked_for(generic, area, kept):
    changed(generic)
    assert generic.read(0x1010, area) == 1
    assert generic.write(0x1010, area, SAVE, 4) == 0

    assert after_reset(generic) == kept
    assert generic.read(0x1010, area) == 1


@pytest.mark.parametrize(
    ("area", "kept"), [(1, [False, False]), (2, [False, True]), (3, [True, False])]
)
def test_a_plain_drive_restores_what_was_asked_for(generic, area, kept):
    changed(generic)
    generic.write(0x1010, 1, SAVE, 4)
    assert generic.write(0x1011, area, LOAD, 4) == 0
    assert generic.read(0x6065) == 77  # not before the reset

    assert after_reset(generic) == kept
    assert after_reset(generic) == kept


def test_two_parts_that_are_saved_one_after_the_other_are_both_kept(generic):
    changed(generic)
    generic.write(0x1010, 2, SAVE, 4)
    generic.write(0x1010, 3, SAVE, 4)

    assert after_reset(generic) == [True, True]


def test_an_epos4_saves_and_restores_everything_or_nothing(bench):
    for index in (0x1010, 0x1011):
        assert bench.read_abort(index, 2) == 0x06090011
    for restored in (1, 4):
        changed(bench)
        bench.write(0x1010, 1, SAVE, 4)
        assert after_reset(bench) == [True, True]
        assert bench.write(0x1011, restored, LOAD, 4) == 0
        assert after_reset(bench) == [False, False]
