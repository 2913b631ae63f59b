"""PDOs against random frames and writes: what they do is known, and no mapping is illegal."""

import struct

import pytest
from drive_bench import GENERIC, HIP, Bench, entries_of
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    rule,
    run_state_machine_as_test,
)

INVALID = 1 << 31
NO_REMOTE = 1 << 30
MODES = {0, 8, 10}


def of_length(*sizes):
    return st.one_of(st.binary(min_size=size, max_size=size) for size in sizes)


FRAMES = st.lists(
    st.tuples(st.just(0x205), st.binary(max_size=8) | of_length(7, 8))
    | st.tuples(st.just(0x305), st.binary(max_size=8) | of_length(2))
    | st.tuples(st.just(0x080), st.just(b"")),
    max_size=25,
)


@given(frames=FRAMES)
@settings(derandomize=True, max_examples=40, deadline=None)
def test_at_each_sync_the_newest_rpdo_of_each_that_is_long_enough_is_used(frames):
    bench = Bench()
    bench.boot()
    bench.go_operational()
    held = {0x6040: 0, 0x6060: bench.read(0x6060), 0x607A: bench.read(0x607A), 0x6071: 0}
    waiting = {}

    for can_id, data in [*frames, (0x080, b"")]:
        bench.send(can_id, data)
        bench.run_ms(1)
        if can_id == 0x205 and len(data) >= 7:
            waiting |= zip((0x6040, 0x6060, 0x607A), struct.unpack("<Hbi", data[:7]), strict=True)
        elif can_id == 0x305 and len(data) >= 2:
            waiting[0x6071] = struct.unpack("<h", data[:2])[0]
        elif can_id == 0x080:
            if waiting.get(0x6060) not in MODES:
                waiting.pop(0x6060, None)
            held, waiting = held | waiting, {}

    masks = {0x6040: 0xFFFF, 0x6060: 0xFF, 0x607A: 0xFFFFFFFF, 0x6071: 0xFFFF}
    assert {i: bench.read(i) for i in held} == {i: v & masks[i] for i, v in held.items()}


CAN_IDS = st.sampled_from([0x000, 0x080, 0x185, 0x1A5, 0x285, 0x405, 0x585, 0x605, 0x705, 0x7FF])
COB_IDS = st.builds(
    lambda can_id, flags: can_id | flags,
    CAN_IDS | st.integers(0, 0x7FF),
    st.sampled_from([0, INVALID, 1 << 30, INVALID | 1 << 30, 1 << 29, 1 << 11, INVALID | 1 << 28]),
)
OBJECTS = st.sampled_from(
    (
        *(0x6041_0010, 0x6064_0020, 0x606C_0020, 0x6061_0008, 0x60FD_0020, 0x6077_0010),
        *(0x6040_0010, 0x6060_0008, 0x607A_0020, 0x6071_0010, 0x1001_0008),
        *(0, 0x6041_0020, 0x6064_0120, 0x5FFF_0010, 0x1018_0120, 0x0005_0008, 0x6065_0020),
    )
)


class AnyMapping(RuleBasedStateMachine):
    """One TPDO and one RPDO, whose objects are written in any order."""

    kind: dict[str, object] = {}  # noqa: RUF012 - set once by each subclass

    def __init__(self):
        super().__init__()
        self.bench = Bench(hip=self.kind)
        self.bench.boot()
        eds = str(self.kind.get("eds", HIP["eds"]))
        self.entries = {entry.address: entry for entry in entries_of(eds, 5)}
        for index in (0x1800, 0x1801, 0x1802, 0x1803, 0x1400, 0x1401, 0x1402, 0x1403):
            self.bench.write(index, 1, self.bench.read(index, 1) | INVALID, 4)
        self.bench.write(0x1800, 2, 1, 1)
        self.bench.write(0x1400, 2, 1, 1)
        self.bench.nmt(0x01)

    def write(self, index, sub, value, size):
        """What is refused changes nothing, what is accepted is what is read."""
        before = self.bench.read(index, sub)
        refused = self.bench.write(index, sub, value, size)
        assert self.bench.read(index, sub) == (before if refused else value)

    directions = st.sampled_from([0x1400, 0x1800])

    @rule(index=directions, cob_id=COB_IDS)
    def write_cob_id(self, index, cob_id):
        self.write(index, 1, cob_id, 4)

    @rule(index=directions, kind=st.integers(0, 255))
    def write_type(self, index, kind):
        self.write(index, 2, kind, 1)

    @rule(index=directions, count=st.integers(0, 10))
    def write_count(self, index, count):
        self.write(index + 0x200, 0, count, 1)

    @rule(index=directions, slot=st.integers(1, 8), entry=OBJECTS | st.integers(0, 2**32 - 1))
    def write_entry(self, index, slot, entry):
        self.write(index + 0x200, slot, entry, 4)

    @rule(index=directions, entries=st.lists(OBJECTS, min_size=1, max_size=5), can_id=CAN_IDS)
    def map_as_a_master_does(self, index, entries, can_id):
        self.write(index, 1, self.bench.read(index, 1) | INVALID, 4)
        self.write(index + 0x200, 0, 0, 1)
        for slot, entry in enumerate(entries, 1):
            self.write(index + 0x200, slot, entry, 4)
        self.write(index + 0x200, 0, len(entries), 1)
        self.write(index, 1, can_id | (NO_REMOTE if index == 0x1800 else 0), 4)

    @rule(data=st.binary(max_size=8) | of_length(8), then_sync=st.booleans())
    def send_what_is_received(self, data, then_sync):
        cob_id = self.bench.read(0x1400, 1)
        if not cob_id & INVALID:
            self.bench.send(cob_id & 0x7FF, data)
        if then_sync:
            self.bench.send(0x080)
        self.bench.run_ms(1)

    def mapped(self, index):
        count = self.bench.read(index + 0x200, 0)
        return [self.bench.read(index + 0x200, slot) for slot in range(1, count + 1)]

    @invariant()
    def what_is_counted_is_legal(self):
        for index in (0x1400, 0x1800):
            entries = self.mapped(index)
            assert sum(entry & 0xFF for entry in entries) <= 64
            for value in entries:
                entry = self.entries[value >> 16, value >> 8 & 0xFF]
                assert entry.size_bytes * 8 == value & 0xFF
                assert entry.mappable_out if index == 0x1800 else entry.mappable_in

    @invariant()
    def what_is_valid_has_objects_and_an_identifier_of_its_own(self):
        for index in (0x1400, 0x1800):
            cob_id = self.bench.read(index, 1)
            assert not cob_id & 0x3FFF_F800
            if not cob_id & INVALID:
                can_id = cob_id & 0x7FF
                assert self.mapped(index)
                assert 0x081 <= can_id <= 0x6DF
                assert not any(can_id in ids for ids in (range(0x101, 0x181), range(0x581, 0x600)))

    @invariant()
    def what_is_sent_at_a_sync_is_what_is_mapped(self):
        bench, cob_id = self.bench, self.bench.read(0x1800, 1)
        if bench.read(0x1800, 2) != 1:
            return
        bench.send(0x080)
        sent = [t for t in bench.run_ms(2) if t.can_id not in (0x585, 0x085, 0x705)]
        if cob_id & INVALID:
            assert sent == []
        else:
            assert [frame.can_id for frame in sent] == [cob_id & 0x7FF]
            assert 8 * len(sent[0].data) == sum(value & 0xFF for value in self.mapped(0x1800))


class Epos4Mapping(AnyMapping):
    """Its COB-IDs are locked while they are valid."""


class PlainMapping(AnyMapping):
    """A new COB-ID may come together with "invalid"."""

    kind = GENERIC


@pytest.mark.parametrize("machine", [Epos4Mapping, PlainMapping])
def test_whatever_is_written_in_whatever_order_no_illegal_mapping_is_active(machine):
    run_state_machine_as_test(
        machine,
        settings=settings(derandomize=True, max_examples=8, stateful_step_count=25, deadline=None),
    )
