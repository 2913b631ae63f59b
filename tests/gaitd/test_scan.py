"""`gaitd scan` on buses in memory: what it finds, what it says of it, and what it never does."""

import itertools

import pytest
from drive_bench import Bench
from drive_files import drive
from hypothesis import given, settings
from hypothesis import strategies as st
from memory_bus import MS, ManualClock, MemoryBus, scripted

from drives.canopen.bus import Frame
from drives.errors import BusError
from drives.service.inventory import FindingKind, inventory_of
from drives.service.scan import PAUSE_FRAMES, survey
from drives.service.stations import Expected, ProfileFile, fitting_profile
from drives.service.vendors import VENDORS, vendor_name
from gaitd_lab.lockstep import WorldBus, WorldClock

DRIVES = (drive("hip_epos4"), drive("slide_epos4"))
PROFILES = (ProfileFile("epos4", "maxon", "EPOS4"), ProfileFile("generic", "any", "CiA 402"))
EXPECTED = Expected(DRIVES, master_node_id=1, profiles=PROFILES)
MBIT = 1_000_000
S = 1_000 * MS


def run(bus, clock, bitrate=MBIT):
    steps = survey(bus, clock, bitrate)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


class Desk:
    """A bus in memory with some nodes, and a scan of it."""

    def __init__(self, *nodes, bus=MemoryBus):
        self.clock = ManualClock()
        self.bus = bus(self.clock, nodes)

    def at_ms(self, *timed):
        for time_ms, can_id, data in timed:
            self.bus.put(Frame(can_id, data), time_ms * MS)
        return self

    def scan(self, expected=EXPECTED, bitrate=MBIT):
        return inventory_of(run(self.bus, self.clock, bitrate), expected)


def both(**behaviour):
    return [scripted(description, **behaviour) for description in DRIVES]


def kinds(found):
    return [finding.kind for finding in found.findings]


def only(found, kind):
    (finding,) = [finding for finding in found.findings if finding.kind is kind]
    return finding


# --- what is there --------------------------------------------------------------------------------


def test_the_drives_of_the_configuration_are_found_and_nothing_is_wrong():
    found = Desk(*both()).scan()

    assert [(s.node_id, s.drive) for s in found.stations] == [(5, "right/hip"), (6, "right/slide")]
    assert found.findings == ()
    hip = found.stations[0]
    assert (hip.vendor, hip.product_code, hip.revision) == ("maxon", 0x61500000, 0x01700000)
    assert (hip.profile_number, hip.power_state) == (402, "switch on disabled")
    assert hip.nmt_state == "unknown"


def test_names_that_need_segments_are_read_and_the_profile_that_fits_is_named():
    bench = Bench(start_ns=0)
    bench.boot()
    bus = WorldBus(bench.world)

    found = inventory_of(run(bus, WorldClock(bus)), EXPECTED)

    hip = found.stations[0]
    assert (hip.device_name, hip.hardware_version) == ("Virtual EPOS4", "")
    assert (hip.software_version, hip.serial) == ("", 305_000_005)  # an EPOS4 has neither
    assert hip.fitting_profile == "epos4"


def test_the_nmt_state_is_the_one_that_heartbeats_tell():
    desk = Desk(*both()).at_ms((10, 0x705, b"\x05"), (20, 0x706, b"\x7f"))

    hip, slide = desk.scan().stations

    assert (hip.nmt_state, slide.nmt_state) == ("operational", "pre operational")


def test_a_powered_drive_shows_its_power_state():
    nodes = both()
    nodes[0].values[0x6041, 0] = 0x1637

    hip, _ = Desk(*nodes).scan().stations

    assert hip.power_state == "operation enabled"


def test_a_device_of_another_profile_is_not_asked_for_a_power_state():
    nodes = both()
    nodes[1].values[0x1000, 0] = 0x0001_0191

    found = Desk(*nodes).scan(Expected(profiles=PROFILES))

    assert (found.stations[1].profile_number, found.stations[1].power_state) == (401, "")
    assert found.stations[1].fitting_profile == ""


def test_without_a_configuration_no_node_is_missing_or_wrong():
    found = Desk(*both()).scan(Expected())

    assert len(found.stations) == 2
    assert not found.is_wrong


def test_a_device_without_1000h_is_there_all_the_same():
    nodes = both()
    del nodes[0].values[0x1000, 0]

    found = Desk(*nodes).scan(Expected())

    assert (found.stations[0].node_id, found.stations[0].device_type) == (5, None)


# --- what is wrong --------------------------------------------------------------------------------


def test_a_missing_drive_is_named_with_its_node_id():
    found = Desk(both()[0]).scan()

    missing = only(found, FindingKind.MISSING)
    assert (missing.node_id, missing.drive) == (6, "right/slide")
    assert found.is_wrong


def test_a_missing_drive_that_sits_at_another_node_id_is_pointed_at():
    hip, slide = both()
    slide.node_id = 9

    found = Desk(hip, slide).scan()

    assert "node 9" in only(found, FindingKind.MISSING).text


@pytest.mark.parametrize(
    ("sub", "value", "said"),
    [
        (1, 0x9A, "vendor is 0000009Ah, its axis file says 000000FBh"),
        (2, 0x65520000, "product is 65520000h, its axis file says 61500000h"),
        (3, 0x01600000, "revision is 01600000h, its axis file says 01700000h"),
    ],
)
def test_another_device_than_the_file_describes_is_told_by_what_differs(sub, value, said):
    nodes = both()
    nodes[0].values[0x1018, sub] = value

    found = Desk(*nodes).scan()

    other = only(found, FindingKind.OTHER_DEVICE)
    assert (other.drive, other.text) == ("right/hip", said)
    assert found.is_wrong


def test_two_devices_with_one_node_id_are_told_by_their_second_answer():
    found = Desk(*both(), scripted(DRIVES[0])).scan()

    assert only(found, FindingKind.DUPLICATE_NODE).node_id == 5
    assert found.is_wrong


def test_answers_to_another_client_s_requests_are_no_second_answers():
    class Busy(MemoryBus):
        def drain(self):
            frames = super().drain()
            # A bring-up reads the same object of the same node: its request, and one more answer.
            asked = [f for f in frames if f.can_id == 0x585 and f.data[1:4] == b"\x18\x10\x01"]
            extra = [Frame(0x605, bytes.fromhex("4018100100000000")), *asked] if asked else []
            return [*extra, *frames]

    found = Desk(*both(), bus=Busy).scan()

    assert FindingKind.DUPLICATE_NODE not in kinds(found)
    assert FindingKind.SDO_CLIENT in kinds(found)


def test_an_answer_to_a_request_from_before_the_bus_was_opened_is_no_second_answer():
    """A service reads a temperature in its cycle."""
    request, answer = bytes.fromhex("4001320100000000"), bytes.fromhex("4b013201fa000000")
    desk = Desk(*both())
    desk.at_ms((0, 0x585, answer), (500, 0x605, request), (501, 0x585, answer))

    assert desk.scan().findings == ()


def test_a_device_under_the_node_id_of_our_master_is_a_duplicate():
    stranger = scripted(DRIVES[0])
    stranger.node_id = 1

    found = Desk(*both(), stranger).scan()

    assert only(found, FindingKind.DUPLICATE_NODE).node_id == 1
    assert [station.node_id for station in found.stations] == [1, 5, 6]


def test_an_empty_bus_costs_no_more_time_than_one_silent_node():
    desk = Desk()
    begun_ns = desk.clock.now_ns()

    found = desk.scan()

    assert desk.clock.now_ns() - begun_ns < 1.5 * S
    assert len(desk.bus.sent) == 127
    assert kinds(found) == [FindingKind.MISSING, FindingKind.MISSING]


# --- the bus itself -------------------------------------------------------------------------------

PASSIVE = Frame(0x004, bytes((0, 0x20, 0, 0, 0, 0, 0, 0)), is_error=True)
NO_ACK = Frame(0x020, bytes(8), is_error=True)
BUS_OFF = Frame(0x040, bytes(8), is_error=True)


class Answering(MemoryBus):
    """The controller says something after our first frame."""

    said = NO_ACK

    def send(self, frames):
        if not self.sent:
            self.put(self.said)
        return super().send(frames)


@pytest.mark.parametrize("said", [NO_ACK, PASSIVE])
def test_where_no_node_acknowledges_no_more_is_sent_and_it_is_said(said):
    desk = Desk(bus=type("Alone", (Answering,), {"said": said}))

    found = desk.scan()

    assert "no node acknowledges" in only(found, FindingKind.NO_ACKNOWLEDGE).text
    assert len(desk.bus.sent) <= 2
    assert found.is_wrong


def test_an_old_error_frame_does_not_keep_it_from_asking():
    desk = Desk(*both())
    desk.bus.put(NO_ACK)

    assert len(desk.scan().stations) == 2


def test_a_transmit_queue_that_stays_full_ends_the_asking():
    class Full(MemoryBus):
        def send_urgent(self, frames, deadline_ns, clock):
            return len(frames)

    desk = Desk(bus=Full)

    found = desk.scan()

    assert only(found, FindingKind.NO_ACKNOWLEDGE)
    assert desk.bus.sent == []


def test_a_controller_that_was_bus_off_is_wrong():
    desk = Desk(bus=type("Off", (Answering,), {"said": BUS_OFF}))

    found = desk.scan(Expected())

    assert FindingKind.BUS_OFF in kinds(found)
    assert found.is_wrong


def test_bus_off_while_objects_are_read_is_an_error_of_the_bus():
    class Breaking(MemoryBus):
        def send(self, frames):
            if any(frame.data[1:3] == b"\x18\x10" for frame in frames):
                self.put(BUS_OFF)
            return super().send(frames)

    with pytest.raises(BusError, match="bus-off"):
        Desk(*both(), bus=Breaking).scan()


def test_error_frames_of_a_bus_that_works_are_told_and_not_wrong():
    desk = Desk(*both(), bus=type("Noisy", (Answering,), {"said": PASSIVE}))
    desk.at_ms((1, 0x705, b"\x7f"))

    found = desk.scan()

    assert kinds(found) == [FindingKind.BUS_ERRORS]
    assert not found.is_wrong


# --- who else is there ----------------------------------------------------------------------------


def test_a_running_service_is_told_by_its_heartbeat_and_its_sync():
    desk = Desk(*both()).at_ms((5, 0x701, b"\x05"), (10, 0x080, b""), (20, 0x080, b""))

    found = desk.scan()

    service = only(found, FindingKind.SERVICE)
    assert service.text == "a service runs: heartbeat of the master (operational), SYNC 2 times"
    assert [station.node_id for station in found.stations] == [5, 6]
    assert not found.is_wrong


def test_sync_and_commands_of_another_node_are_told():
    desk = Desk(*both()).at_ms((10, 0x080, b""), (20, 0x000, b"\x01\x05"))

    texts = [finding.text for finding in desk.scan().findings]

    assert texts == [
        "SYNC 1 times: and no heartbeat of node 1",
        "another node sent 1 NMT commands",
    ]


def test_a_node_that_is_heard_and_does_not_answer_is_told_with_its_state():
    desk = Desk(*both()).at_ms((10, 0x709, b"\x04"), (12, 0x70A, b"\x05"))

    found = desk.scan()

    silent = [f.text for f in found.findings if f.kind is FindingKind.SILENT_NODE]
    assert silent == [
        "sends (stopped), but does not answer: no SDO in STOPPED",
        "sends (operational), but does not answer: a master?",
    ]


def test_a_node_that_stops_answering_is_waited_for_once():
    nodes = both()
    nodes[0].mute = {(0x1018, 1), (0x1018, 2), (0x1018, 3), (0x6041, 0)}
    desk = Desk(*nodes)

    found = desk.scan()

    assert kinds(found) == [FindingKind.FELL_SILENT]
    assert found.is_wrong
    assert [f.data[1:4] for f in desk.bus.sent if f.can_id == 0x605 and f.data[0] == 0x40][-1] == (
        b"\x18\x10\x01"
    )


def test_boot_ups_and_emergencies_while_we_listened_are_told():
    emcy = bytes.fromhex("1086110000000000")
    desk = Desk(*both()).at_ms((10, 0x705, b"\x00"), (20, 0x705, b"\x00"), (30, 0x086, emcy))

    found = desk.scan()

    assert only(found, FindingKind.BOOTED).text == "booted 2 times during the scan"
    assert only(found, FindingKind.EMERGENCY).text.startswith("EMCY 8610h during the scan")


def test_requests_to_a_node_that_is_not_there_are_told():
    desk = Desk(*both()).at_ms((10, 0x609, bytes.fromhex("4000100000000000")))

    assert "node 9" in only(desk.scan(), FindingKind.SDO_CLIENT).text


def test_a_drive_of_the_file_that_beats_and_does_not_answer_is_missing():
    hip, slide = both()
    slide.dead = True
    desk = Desk(hip, slide).at_ms((10, 0x706, b"\x7f"))

    found = desk.scan()

    texts = [finding.text for finding in found.findings]
    assert texts == [
        "sends (pre operational), but does not answer",
        "no answer from node 6",
    ]


def test_what_is_no_heartbeat_under_a_heartbeat_s_identifier_is_told():
    desk = Desk(*both()).at_ms((10, 0x705, b""), (20, 0x705, b"\x05\x00"))

    found = desk.scan()

    assert only(found, FindingKind.UNEXPLAINED).text.startswith(
        "2 malformed frames with the identifier"
    )
    assert found.stations[0].nmt_state == "unknown"


def test_a_pending_error_is_told_in_the_drive_s_own_words():
    nodes = both()
    nodes[1].values[0x603F, 0] = 0x8A88

    found = Desk(*nodes).scan()

    pending = only(found, FindingKind.ERROR_PENDING)
    assert pending.drive == "right/slide"
    assert "safe torque off" in pending.text
    assert found.stations[1].error_text in pending.text


def test_unexplained_frames_are_counted_by_identifier():
    desk = Desk(*both()).at_ms(
        (10, 0x1A5, b"\1"), (11, 0x1A5, b"\2"), (12, 0x6A0, b""), (13, 0x185, b""), (14, 0x100, b"")
    )

    texts = [f.text for f in desk.scan().findings if f.kind is FindingKind.UNEXPLAINED]

    assert texts == [
        "2 frames 1A5h: a PDO of node 37, which does not exist",
        "1 frames 6A0h: not an identifier of CANopen",
    ]


# --- what it never does ---------------------------------------------------------------------------

UPLOADS = {0x40, 0x60, 0x70}
"""Initiate upload, upload segment with either toggle bit (CiA 301 7.2.4.3.7)."""


def uploads_only(frames):
    return all(0x601 <= f.can_id <= 0x67F and f.data[0] in UPLOADS for f in frames)


def test_it_sends_no_frame_but_sdo_uploads():
    bench = Bench(start_ns=0)
    bench.boot()
    bus = WorldBus(bench.world)

    run(bus, WorldClock(bus))

    assert len(bus.sent) > 127 + 2 * 11
    assert uploads_only(bus.sent)


@pytest.mark.parametrize("bitrate", [125_000, 1_000_000])
def test_it_leaves_the_bus_to_others_between_two_requests(bitrate):
    desk = Desk(*both())
    times_ns = []
    send = desk.bus.send

    def noted(frames):
        times_ns.extend(desk.clock.now_ns() for _ in frames)
        return send(frames)

    desk.bus.send = noted
    desk.scan(bitrate=bitrate)

    gaps = [after - before for before, after in itertools.pairwise(times_ns)]
    frame_ns = 111 * S // bitrate  # eight bytes without a stuff bit
    assert min(gaps) >= PAUSE_FRAMES * frame_ns


def test_where_another_client_talks_to_a_node_nothing_in_segments_is_asked_of_it():
    names = {b"\x08\x10\x00", b"\x09\x10\x00", b"\x0a\x10\x00"}
    desk = Desk(*both()).at_ms((100, 0x605, bytes.fromhex("2b17100032000000")))

    found = desk.scan()

    asked = {f.data[1:4] for f in desk.bus.sent if f.can_id == 0x605}
    assert not asked & names
    assert names <= {f.data[1:4] for f in desk.bus.sent if f.can_id == 0x606}
    assert only(found, FindingKind.SDO_CLIENT).node_id == 5


FRAMES = st.builds(
    Frame,
    st.one_of(
        st.integers(0, 0x7FF),
        st.sampled_from((0x000, 0x080, 0x085, 0x185, 0x585, 0x605, 0x705, 0x586, 0x706)),
    ),
    st.binary(max_size=8),
    time_ns=st.just(0),
    is_error=st.just(False),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 1400), FRAMES), max_size=40))
def test_whatever_is_sent_on_the_bus_the_scan_ends_and_only_reads(traffic):
    desk = Desk(*both())
    for time_ms, frame in traffic:
        desk.bus.put(frame, time_ms * MS)

    found = desk.scan()

    aborts = [f for f in desk.bus.sent if f.data[0] == 0x80]  # of an upload that went wrong
    assert uploads_only(f for f in desk.bus.sent if f not in aborts)
    assert not any(node.written for node in desk.bus.nodes)
    assert {5, 6} <= {station.node_id for station in found.stations}


# --- words ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("vendor", "name", "number", "fits"),
    [
        ("maxon", "EPOS4 50/5", 402, "epos4"),
        ("maxon", "IDX", 402, "epos4?"),
        ("", "Some drive", 402, "generic?"),
        ("", "A CiA 402 drive", 402, "generic?"),
        ("maxon", "EPOS4 50/5", 401, ""),
    ],
)
def test_a_profile_fits_by_vendor_and_name_or_is_a_guess(vendor, name, number, fits):
    assert fitting_profile(vendor, name, number, PROFILES) == fits


def test_vendors_are_named_by_their_id_and_unknown_ones_are_not():
    assert [vendor_name(number) for number in (0xFB, 0x9A, 0x147)] == ["maxon", "Elmo", "Faulhaber"]
    assert vendor_name(0x29A) == ""
    assert len(set(VENDORS.values())) == len(VENDORS)
