"""What `gaitd drive` decides: what is read, what differs, what is kept and when it is refused."""

import io
import itertools
import struct

import canopen
import hypothesis
import pytest
from canopen.objectdictionary import ODVariable, datatypes
from drive_bench import Bench
from drive_files import CYCLE, FOLDER, HIP_LIMITS, SLIDE_LIMITS, drive
from hypothesis import assume, given
from hypothesis import strategies as st
from memory_bus import MS, ManualClock, MemoryBus, scripted

from drives.bringup.bringup import bring_up
from drives.bringup.configurator import Configurator
from drives.bringup.plan import plan
from drives.bringup.steps import StepKind
from drives.canopen.bus import Frame
from drives.canopen.data_sheet import Variable
from drives.canopen.sniffer import BusSniffer
from drives.errors import BringUpRefused, DescriptionError, DriveSilent, SdoTimeout
from drives.service.compare import expected_of, in_hex, read_with_plan, with_values
from drives.service.dump import (
    PAUSE_NS,
    Entry,
    decoded,
    defaults,
    kept_text,
    read_dcf,
    read_objects,
    readable,
    settings,
    write_dcf,
)
from drives.service.eds import load_eds
from drives.service.object_texts import ObjectWords
from drives.service.parameters import (
    SDO_TIMEOUT_NS,
    Command,
    ParameterRefusedError,
    check_bus,
    check_drive,
    execute,
    reset_node,
)
from gaitd_lab.lockstep import WorldBus, WorldClock

KINDS = ("epos4", "generic")
LIMITS = {"hip": HIP_LIMITS, "slide": SLIDE_LIMITS}


def plan_for(axis="hip", kind="epos4"):
    return plan(drive(f"{axis}_{kind}"), LIMITS[axis], CYCLE)


def eds_of(a_plan):
    return load_eds(a_plan.description.eds, a_plan.description.node_id)


def finished(steps):
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def compared(a_plan, port):
    return finished(read_with_plan(a_plan, eds_of(a_plan), port))


def differing(a_plan, port):
    return [one for one in compared(a_plan, port) if not one.same]


class Desk:
    """One scripted drive on a bus in memory."""

    def __init__(self, axis="hip", kind="epos4", **behaviour):
        self.plan = plan_for(axis, kind)
        self.clock = ManualClock()
        self.node = scripted(self.plan.description, **behaviour)
        self.bus = MemoryBus(self.clock, [self.node])
        self.port = Configurator(self.bus, self.clock)


def brought_up(kind):
    desk = Desk(kind=kind)
    finished(bring_up([desk.plan], desk.port, CYCLE))
    return desk


# --- compare with the plan ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_what_bring_up_leaves_behind_is_what_compare_wants(kind):
    desk = brought_up(kind)

    assert differing(desk.plan, desk.port) == []


@pytest.mark.parametrize("kind", KINDS)
def test_the_virtual_drives_after_bring_up_are_what_compare_wants(kind):
    changes = {
        "personality": kind,
        "eds": f"drives/{'epos4' if kind == 'epos4' else 'generic402'}.eds",
    }
    bench = Bench(hip=changes, slide=changes, start_ns=0)
    bench.boot()
    bus = WorldBus(bench.world)
    port = Configurator(bus, WorldClock(bus))
    plans = [plan_for("hip", kind), plan_for("slide", kind)]
    before = [len(differing(one, port)) for one in plans]
    finished(bring_up(plans, port, CYCLE))

    assert min(before) > 10
    assert [differing(one, port) for one in plans] == [[], []]


def spoiled(expected, before, bits, signed):
    """Another value of an object than its plan wants."""
    wrong = (before ^ expected.step.mask & -expected.step.mask) & ((1 << bits) - 1)
    if expected.step.kind is StepKind.SWITCH_OFF:
        wrong = before ^ 1 << 31
    if expected.step.kind is StepKind.COMPARE:
        wrong = round(before * 1.02)
    return wrong - (1 << bits) if signed and wrong >> (bits - 1) else wrong


@pytest.mark.parametrize("kind", KINDS)
def test_the_objects_of_the_plan_that_are_changed_are_the_differences(kind):
    desk = brought_up(kind)
    plan = expected_of(desk.plan, eds_of(desk.plan))

    for part in (plan[0::3], plan[1::3], plan[2::3]):
        before = dict(desk.node.values)
        for expected in part:
            bits, signed, _ = desk.node.kinds[expected.address]
            value = spoiled(expected, before[expected.address], bits, signed)
            desk.node.values[expected.address] = value

        found = differing(desk.plan, desk.port)

        assert [(one.index, one.sub, one.why) for one in found] == [
            (*expected.address, expected.step.why) for expected in part
        ]
        desk.node.values |= before


def test_a_difference_says_what_was_wanted_what_was_found_and_why():
    desk = brought_up("epos4")
    desk.node.values[0x6007, 0] = 0

    (found,) = differing(desk.plan, desk.port)

    assert (found.place, found.wanted, found.found) == ("6007h:00", "3", "0")
    assert found.why == "without its master the drive makes a quick stop"


def test_of_a_mapping_it_is_the_last_word_that_counts():
    wanted = {one.address: one.wanted for one in expected_of(plan_for(), eds_of(plan_for()))}

    assert wanted[0x1A00, 0] == "3"
    assert wanted[0x1800, 1] == "00000185h"  # bit 30 is not compared
    assert wanted[0x1803, 1] == "off (bit 31)"
    assert wanted[0x607D, 1].startswith("-")
    assert not wanted[0x607D, 2].startswith("-")


def test_where_the_joint_is_and_what_is_only_reported_is_not_expected():
    wanted = {one.address for one in expected_of(plan_for(), eds_of(plan_for()))}

    assert not wanted & {(0x607A, 0), (0x603F, 0), (0x1001, 0), (0x6041, 0)}


def test_a_torque_base_of_zero_is_a_difference_and_half_a_per_cent_is_none():
    desk = brought_up("epos4")
    desk.node.values[0x6076, 0] = round(desk.node.values[0x6076, 0] * 1.005)
    assert differing(desk.plan, desk.port) == []

    desk.node.values[0x6076, 0] = 0
    assert [one.place for one in differing(desk.plan, desk.port)] == ["6076h:00"]


def test_an_object_that_cannot_be_read_differs_with_the_abort_s_text():
    desk = brought_up("epos4")
    del desk.node.values[0x6085, 0]

    (found,) = differing(desk.plan, desk.port)

    assert (found.place, found.found) == ("6085h:00", "Object does not exist (06020000h)")


# --- reading --------------------------------------------------------------------------------------


def test_one_request_is_outstanding_at_a_time_and_the_bus_is_left_to_others_in_between():
    desk = Desk()
    times_ns, outstanding = [], []
    take, send = desk.port._receive, desk.bus.send

    def sending(frames):
        outstanding.extend(frames)
        assert len(outstanding) == 1
        times_ns.append(desk.clock.now_ns())
        return send(frames)

    def taking(frame):
        outstanding.clear()
        take(frame)

    desk.bus.send, desk.port._receive = sending, taking
    finished(read_objects(5, readable(eds_of(desk.plan)), desk.port))

    gaps_ns = [after - before for before, after in itertools.pairwise(times_ns)]
    assert len(times_ns) > 100
    assert min(gaps_ns) >= PAUSE_NS


def test_a_dump_writes_nothing():
    desk = Desk()

    finished(read_objects(5, readable(eds_of(desk.plan)), desk.port, as_filled=True))

    assert desk.node.written == []
    assert {frame.can_id for frame in desk.bus.sent} == {0x605}


def test_an_array_and_a_mapping_are_read_as_far_as_they_are_filled():
    desk = Desk()
    desk.node.values[0x1003, 0] = 2
    desk.node.values[0x1600, 0] = 1

    entries = finished(read_objects(5, readable(eds_of(desk.plan)), desk.port, as_filled=True))

    assert [e.sub for e in entries if e.index == 0x1003] == [0, 1, 2]
    assert [e.sub for e in entries if e.index == 0x1600] == [0, 1]
    assert [e.sub for e in entries if e.index == 0x1018] == [0, 1, 2, 3, 4]


def test_one_object_without_an_answer_is_noted_and_the_rest_is_read():
    desk = Desk(mute={(0x6065, 0)})

    entries = finished(read_objects(5, readable(eds_of(desk.plan)), desk.port))

    silent = [entry for entry in entries if entry.trouble.startswith("no answer")]
    assert [entry.place for entry in silent] == ["6065h:00"]
    assert entries[-1].value is not None


def test_a_drive_that_is_gone_ends_the_reading_soon():
    desk = Desk(dead=True)

    with pytest.raises(SdoTimeout):
        finished(read_objects(5, readable(eds_of(desk.plan)), desk.port))

    requests = [frame for frame in desk.bus.sent if frame.data[0] == 0x40]
    assert len(requests) == 3


INTEGERS = sorted(datatypes.INTEGER_TYPES)


@given(st.sampled_from(INTEGERS), st.integers(), st.binary(max_size=3))
def test_numbers_mean_what_canopen_says_even_with_bytes_behind_them(kind, number, behind):
    theirs = ODVariable("any", 0x2000)
    theirs.data_type = kind
    bits = len(theirs)
    low = -(1 << (bits - 1)) if kind in datatypes.SIGNED_TYPES else 0
    value = low + number % (1 << bits)
    data = theirs.encode_raw(value)

    ours = Variable(0x2000, 0, data_type=kind)
    assert decoded(ours, data + behind) == theirs.decode_raw(data) == value
    assert int(in_hex(value, bits)[:-1], 16) == value % (1 << bits)


def test_texts_floats_and_bytes_are_decoded_by_their_type():
    def of(kind, data):
        return decoded(Variable(0x2000, 0, data_type=kind), data)

    assert of(datatypes.VISIBLE_STRING, b"EPOS4 \x01\0rest") == "EPOS4 ?"
    assert of(datatypes.UNICODE_STRING, "é".encode("utf-16-le")) == "é"
    assert of(datatypes.REAL32, struct.pack("<f", 0.25)) == 0.25
    assert of(datatypes.REAL64, struct.pack("<d", -1e9)) == -1e9
    assert of(datatypes.BOOLEAN, b"\1") == 1
    assert of(datatypes.DOMAIN, b"\x01\xfe") == "01fe"


# --- DCF ------------------------------------------------------------------------------------------


def kept(entries, tmp_path):
    file = io.StringIO()
    write_dcf(entries, eds_of(plan_for()), 5, file)
    path = tmp_path / "hip.dcf"
    path.write_text(file.getvalue(), encoding="utf-8")
    return path


def test_a_dump_kept_in_a_dcf_is_read_again_value_for_value(tmp_path):
    desk = Desk()
    desk.node.values[0x6064, 0] = -4096
    desk.node.values[0x607D, 1] = -(1 << 31)
    entries = finished(read_objects(5, readable(eds_of(desk.plan)), desk.port))

    values = read_dcf(str(kept(entries, tmp_path)), 5)

    assert values == {(e.index, e.sub): e.value for e in entries if e.value is not None}
    assert values[0x6064, 0] == -4096


def test_what_a_drive_answers_with_a_wrong_length_spoils_no_dump(tmp_path):
    entries = (Entry(0x6065, 0, "", "0102ff"), Entry(0x1008, 0, "", "EPOS4"))

    assert read_dcf(str(kept(entries, tmp_path)), 5) == {(0x1008, 0): "EPOS4"}


def test_canopen_reads_our_dcf_with_node_id_and_defaults(tmp_path):
    entries = (Entry(0x6065, 0, "", 1234, 32), Entry(0x1008, 0, "", "EPOS4 50/5"))

    dictionary = canopen.import_od(str(kept(entries, tmp_path)))

    assert dictionary.node_id == 5
    assert dictionary[0x6065].value == 1234
    assert dictionary[0x6065].default == 2000
    assert dictionary[0x1008].value == "EPOS4 50/5"
    assert dictionary[0x6085].value is None
    assert dictionary[0x1800][1].default == 0x40000185


@hypothesis.settings(max_examples=10)
@given(st.integers(-(1 << 31), (1 << 31) - 1), st.text(max_size=20))
def test_any_number_and_any_text_survive_a_dcf(tmp_path_factory, number, text):
    name = kept_text(text)
    assume(name.isascii())
    entries = (Entry(0x6064, 0, "", number, 32), Entry(0x1008, 0, "", name))

    values = read_dcf(str(kept(entries, tmp_path_factory.mktemp("dcf"))), 5)

    assert values == {(0x6064, 0): number, (0x1008, 0): name}


@pytest.mark.parametrize("content", [None, "", "no ini at all", "[6065]\nParameterName=x\n"])
def test_a_file_that_is_no_dump_is_refused_by_its_name(tmp_path, content):
    path = tmp_path / "some.dcf"
    if content is not None:
        path.write_text(content)

    with pytest.raises(DescriptionError) as caught:
        read_dcf(str(path), 5)
    assert caught.value.value == str(path)


def test_an_eds_is_no_dump():
    with pytest.raises(DescriptionError, match="no ParameterValue"):
        read_dcf(str(FOLDER / "epos4.eds"), 5)


def test_only_settings_are_compared_with_an_eds_or_a_dump():
    dictionary = eds_of(plan_for())
    places = {variable.address for variable in settings(dictionary)}

    assert (0x6065, 0) in places
    assert (0x1005, 0) in places
    assert not places & {(0x6041, 0), (0x6064, 0), (0x603F, 0)}


def test_a_fresh_drive_holds_its_eds_s_defaults_but_for_the_motor():
    desk = Desk()
    dictionary = eds_of(desk.plan)
    wanted = defaults(dictionary)
    variables = [v for v in settings(dictionary) if desk.node.kinds.get(v.address)]
    entries = finished(read_objects(5, variables, desk.port))

    found = with_values(wanted, [e for e in entries if (e.index, e.sub) in wanted], "EDS default")

    assert [one.place for one in found if not one.same] == ["3001h:05", "6076h:00"]
    assert next(one for one in found if one.place == "3001h:05").found == "55736 (0000D9B8h)"


# --- store and restore ----------------------------------------------------------------------------


def witness_of(*frames):
    sniffer = BusSniffer()
    for frame in frames:
        sniffer.received(frame, 0)
    return sniffer


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (Frame(0x080, b""), "SYNC, 1 times"),
        (Frame(0x701, b"\x05"), "the master's heartbeat, 1 times"),
        (Frame(0x000, b"\x01\x05"), "NMT commands, 1 times"),
        (Frame(0x606, bytes.fromhex("4000100000000000")), "SDO requests of another client"),
    ],
)
def test_whoever_works_on_the_bus_is_a_reason_to_refuse(frame, said):
    with pytest.raises(ParameterRefusedError, match=said):
        check_bus(witness_of(frame), 1)


def test_drives_that_only_beat_are_no_reason_to_refuse():
    check_bus(witness_of(Frame(0x705, b"\x7f"), Frame(0x086, bytes(8))), 1)


@pytest.mark.parametrize("keeping", Command)
@pytest.mark.parametrize(
    ("statusword", "state"),
    [
        (0x0637, "operation enabled"),
        (0x0633, "switched on"),
        (0x0617, "quick stop active"),
        (0x061F, "fault reaction active"),
        (0x06FF, "unknown"),
    ],
)
def test_a_drive_with_power_or_in_no_known_state_is_refused(keeping, statusword, state):
    desk = Desk()
    desk.node.values[0x6041, 0] = statusword

    with pytest.raises(ParameterRefusedError, match=state):
        check_drive(desk.plan, keeping, desk.port)
    assert desk.node.written == []


@pytest.mark.parametrize("statusword", [0x0240, 0x0221, 0x0208])
def test_a_drive_without_power_may_be_asked(statusword):
    desk = Desk()
    desk.node.values[0x6041, 0] = statusword

    check_drive(desk.plan, Command.STORE, desk.port)


@pytest.mark.parametrize("keeping", Command)
def test_a_drive_that_does_not_do_it_on_command_is_refused(keeping):
    desk = Desk()
    desk.node.values[keeping.index, 1] = 2

    with pytest.raises(ParameterRefusedError, match="on command"):
        check_drive(desk.plan, keeping, desk.port)


def test_another_drive_than_the_file_describes_is_not_asked():
    desk = Desk()
    desk.node.values[0x1018, 2] = 0x65520000

    with pytest.raises(BringUpRefused) as caught:
        check_drive(desk.plan, Command.STORE, desk.port)
    assert caught.value.place == "1018h:02"


@pytest.mark.parametrize("keeping", Command)
def test_the_signature_is_written_once_and_a_refusal_carries_the_abort_s_text(keeping):
    desk = Desk(abort_write={(keeping.index, 1): 0x0800_0022})

    with pytest.raises(ParameterRefusedError, match=r"08000022h, .*present device state"):
        execute(desk.plan, keeping, desk.port)

    writes = [frame.data for frame in desk.bus.sent if frame.data[0] == 0x23]
    assert writes == [struct.pack("<BHB", 0x23, keeping.index, 1) + keeping.signature]


def test_a_drive_that_takes_seconds_is_waited_for_and_one_that_never_answers_is_not_believed():
    desk = Desk(mute={(0x1010, 1)})
    desk.bus.put(Frame(0x585, bytes.fromhex("6010100100000000")), 3_000 * MS)
    patient = Configurator(desk.bus, desk.clock, SDO_TIMEOUT_NS)

    execute(desk.plan, Command.STORE, patient)

    with pytest.raises(DriveSilent, match="it is unknown"):
        execute(desk.plan, Command.STORE, patient)


@pytest.fixture
def world():
    bench = Bench(start_ns=0)
    bench.boot()
    bus = WorldBus(bench.world)
    return bench, bus, Configurator(bus, WorldClock(bus))


def test_what_is_stored_outlives_a_reset_and_what_is_restored_comes_with_one(world):
    bench, _, port = world
    hip = plan_for()
    bench.write(0x6065, 0, 1234, 4)

    check_drive(hip, Command.STORE, port)
    execute(hip, Command.STORE, port)
    finished(reset_node(hip, port))
    assert bench.read(0x6065) == 1234

    bench.run_ms(500)
    check_drive(hip, Command.RESTORE, port)
    execute(hip, Command.RESTORE, port)
    assert bench.read(0x6065) == 1234
    finished(reset_node(hip, port))
    assert bench.read(0x6065) == 2000


def test_only_the_drive_that_is_meant_is_reset(world):
    _, bus, port = world

    finished(reset_node(plan_for(), port))

    assert [frame.data for frame in bus.sent if frame.can_id == 0] == [b"\x81\x05"]
    assert port.traffic(6).boot_up_count == 0


def test_a_drive_that_does_not_come_back_after_a_reset_is_told():
    desk = Desk(dead=True)

    with pytest.raises(DriveSilent, match="no boot-up message within 5 s"):
        finished(reset_node(desk.plan, desk.port))


# --- words ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("index", "sub", "value", "said"),
    [
        (0x1000, 0, 0x00020192, "CiA 402"),
        (0x1003, 1, 0x00008130, "CAN heartbeat: the master's heartbeat was lost"),
        (0x1010, 1, 3, "saves on command and by itself"),
        (0x1016, 2, 0, "monitors no node"),
        (0x1016, 2, 0x00010064, "node 1 within 100 ms"),
        (0x1802, 1, 0xC0000385, "identifier 385h, off"),
        (0x1803, 2, 255, "on an event"),
        (0x1803, 2, 1, "with every SYNC"),
        (0x1803, 2, 10, "with every 10th SYNC"),
        (0x1A03, 1, 0x606C0020, "606Ch:00, 32 bits"),
        (0x30D1, 2, -5, "torque source in milliampere"),
        (0x603F, 0, 0, "no error"),
        (0x6041, 0, 0x0208, "fault"),
        (0x6061, 0, 8, "cyclic sync position"),
        (0x60FD, 0, 1 << 17, "STO released"),
        (0x60FD, 0, 0, "no named input holds"),
        (0x6502, 0, 0x3A5, "PP, PV, HM, CSP, CSV, CST"),
        (0x2FFF, 0, 7, ""),
    ],
)
def test_a_value_is_put_into_words_where_its_meaning_is_known(index, sub, value, said):
    assert said in ObjectWords(plan_for()).text_of(index, sub, value)
    assert bool(said) == bool(ObjectWords(plan_for()).text_of(index, sub, value))


def test_a_value_that_bring_up_would_change_is_told_with_what_it_wants():
    words = ObjectWords(plan_for())

    assert words.text_of(0x6080, 0, 50_000).startswith("bring-up expects ")
    assert words.text_of(0x6080, 0, 50_000).endswith("speed limit in rpm")
    assert words.text_of(0x6007, 0, 3) == "without its master the drive makes a quick stop"
