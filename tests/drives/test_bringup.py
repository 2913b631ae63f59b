import dataclasses

import msgspec
import pytest
from bringup_bench import RESET_COMMUNICATION, START, Bench, refused, silent
from drive_files import CYCLE, HIP_LIMITS, drive
from memory_bus import MS

from drives.bringup.bringup import bring_up
from drives.bringup.plan import plan
from drives.canopen.bus import Frame
from drives.canopen.bus_state import BusCondition
from drives.canopen.nmt import SyncProducer
from drives.errors import BringUpRefused, BusError, DrivePowered, DriveSilent
from drives.signals import NmtState, PowerState

# --- what goes well -------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["epos4", "generic"])
def test_bring_up_ends_with_both_drives_operational_and_reported(kind):
    bench = Bench(kind)
    bench.hip.values[0x6064, 0] = 4096

    hip, slide = bench.run()

    assert (bench.hip.nmt_state, bench.slide.nmt_state) == (0x05, 0x05)
    assert (hip.name, slide.name) == ("right/hip", "right/slide")
    assert hip.power_state is PowerState.SWITCH_ON_DISABLED
    assert hip.position_counts == 4096


def test_no_drive_is_started_before_all_are_configured():
    bench = Bench()

    bench.run()

    starts = [n for n, frame in enumerate(bench.bus.sent) if frame == Frame(0, b"\x01\x05")]
    last_sdo = max(n for n, frame in enumerate(bench.bus.sent) if frame.can_id & 0x780 == 0x600)
    assert starts
    assert starts[0] > last_sdo


def test_all_drives_are_reset_before_any_is_configured():
    bench = Bench()

    bench.run()

    assert [frame.data[:1] for frame in bench.bus.sent[:2]] == [RESET_COMMUNICATION] * 2


@pytest.mark.parametrize("statusword", [0x0240, 0x0231, 0x0218])
def test_bring_up_never_enables_and_never_resets_a_fault_whatever_it_finds(statusword):
    bench = Bench()
    bench.hip.values[0x6041, 0] = statusword

    hip, _ = bench.run()

    assert hip.statusword == statusword
    assert not bench.touched_power()


@pytest.mark.parametrize("statusword", [0x0233, 0x1637, 0x0617, 0x061F])
def test_a_drive_that_holds_its_joint_goes_on_holding_it_until_a_reset(statusword):
    bench = Bench()
    bench.slide.values[0x6041, 0] = statusword

    with pytest.raises(DrivePowered) as caught:
        bench.run()

    assert caught.value.drive == "right/slide"
    assert START not in [data[:1] for data in bench.sent(0)]
    assert not bench.touched_power()


def test_a_drive_that_is_not_switched_off_when_asked_is_named():
    bench = Bench()
    bench.hip.values[0x6041, 0] = 0x1637

    with pytest.raises(DriveSilent, match="stays in OPERATION_ENABLED"):
        bench.run(may_switch_off=True)
    assert START not in [data[:1] for data in bench.sent(0)]


def test_every_limit_of_the_design_is_in_the_drive_afterwards():
    bench = Bench("generic")

    bench.run()

    hip = bench.hip.values
    assert (hip[0x607D, 1], hip[0x607D, 2]) == (-4889, 19556)  # 1024*100/2pi = 16297.47 per rad
    assert hip[0x605A, 0] == 6
    assert hip[0x605E, 0] == 2
    assert hip[0x6007, 0] == 3
    assert hip[0x1016, 1] == 0x00010064
    assert hip[0x1017, 0] == 20
    assert hip[0x1400, 5] == 30
    assert (hip[0x60C2, 1], hip[0x60C2, 2]) == (10, -3)


def test_pdos_that_the_mapping_does_not_use_are_switched_off():
    bench = Bench()

    bench.run()

    for index in (0x1402, 0x1403, 0x1803):
        assert bench.hip.values[index, 1] & 0x80000000


def test_a_pdo_is_remapped_in_the_order_that_the_standard_asks_for():
    bench = Bench()

    bench.run()

    touched = [w for w in bench.hip.written if w[0] in (0x1800, 0x1A00)]
    assert touched == [
        (0x1800, 1, 0xC0000185),
        (0x1800, 2, 1),
        (0x1800, 3, 0),  # 1 ms as delivered
        (0x1A00, 0, 0),
        (0x1A00, 1, 0x60410010),
        (0x1A00, 2, 0x60640020),
        (0x1A00, 3, 0x60610008),
        (0x1A00, 0, 3),
        (0x1800, 1, 0x40000185),
    ]


def test_the_identifier_that_a_pdo_has_is_switched_off_first_not_the_one_it_will_get():
    bench = Bench(hip={"stored": {(0x1800, 1): 0x400001A5}})

    bench.run()

    identifiers = [w[2] for w in bench.hip.written if w[:2] == (0x1800, 1)]
    assert identifiers == [0xC00001A5, 0x40000185]


def test_the_target_is_seeded_with_the_position_so_that_a_change_of_mode_finds_no_way_to_go():
    bench = Bench()
    bench.hip.values[0x6064, 0] = 1234
    bench.hip.values[0x6071, 0] = 500

    bench.run()

    assert bench.hip.values[0x607A, 0] == 1234
    assert bench.hip.values[0x6071, 0] == 0
    assert bench.hip.values[0x6060, 0] == 10


@pytest.mark.parametrize("old", [(-100_000, -50_000), (50_000, 100_000), (-1, 1)])
def test_position_limits_move_without_ever_crossing_the_old_ones(old):
    bench = Bench()
    bench.hip.values[0x607D, 1], bench.hip.values[0x607D, 2] = old

    bench.run()

    low, high = old
    for _, sub, value in [w for w in bench.hip.written if w[0] == 0x607D]:
        low, high = (value, high) if sub == 1 else (low, value)
        assert low <= high


def test_the_base_that_the_drive_holds_is_the_one_that_is_used():
    bench = Bench()
    bench.hip.values[0x6076, 0] = 280_000  # 0.5 % more than the axis file says

    hip, _ = bench.run()

    assert hip.base.rated_torque_nm == pytest.approx(0.280)


def test_of_many_emcys_during_bring_up_the_newest_eight_are_in_the_report():
    bench = Bench()
    for number in range(10):
        frame = Frame(0x085, bytes.fromhex("308111") + bytes((number, 0, 0, 0, 0)))
        bench.bus.put(frame, (10 + number) * MS)

    hip, _ = bench.run()

    assert [came.vendor_bytes[0] for came in hip.emergencies] == list(range(2, 10))


def test_a_node_that_was_never_received_has_sent_nothing():
    traffic = Bench().port.traffic(9)

    assert (traffic.boot_up_count, traffic.heartbeat_count) == (0, 0)
    assert traffic.nmt_state is NmtState.UNKNOWN


def test_no_step_of_bring_up_takes_longer_than_one_silent_transfer():
    bench = Bench(slide={"mute": {(0x6085, 0)}})
    steps = bring_up(bench.plans, bench.port, CYCLE)
    longest_ns = 0

    with pytest.raises(DriveSilent):
        while True:
            before_ns = bench.clock.now_ns()
            try:
                next(steps)
            finally:
                longest_ns = max(longest_ns, bench.clock.now_ns() - before_ns)

    assert longest_ns <= 310 * MS


def test_an_encoder_error_that_is_found_or_comes_during_bring_up_loses_the_reference():
    found = Bench()
    found.hip.values[0x603F, 0] = 0x7388
    came = Bench()
    came.bus.put(Frame(0x086, bytes.fromhex("2073010000000000")), 10 * MS)

    assert [report.reference_lost for report in found.run()] == [True, False]
    assert [report.reference_lost for report in came.run()] == [False, True]


# --- boot -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("boots_ns", [(0, ()), (0, (3 * MS,)), (5 * MS, (5 * MS,))])
def test_a_boot_up_message_is_never_missed_and_counts_once(boots_ns):
    delay_ns, extra_ns = boots_ns
    bench = Bench(hip={"boot_delay_ns": delay_ns, "extra_boots_ns": extra_ns})

    assert bench.run()


def test_a_boot_up_message_from_before_the_reset_is_not_taken_for_the_answer():
    bench = Bench(hip={"dead": True})
    bench.bus.put(Frame(0x705, b"\x00"))

    assert "no boot-up message" in str(silent(bench))


# --- refusals -------------------------------------------------------------------------------------


def test_another_product_than_the_files_describe_is_refused_with_both_numbers():
    bench = Bench(hip={"stored": {(0x1018, 2): 0x65510000}})

    error = refused(bench)

    assert (error.drive, error.place) == ("right/hip", "1018h:02")
    assert "65510000" in str(error)
    assert "61500000" in str(error)


def test_a_mapping_that_the_drive_refuses_is_named_with_object_entry_and_abort_text():
    error = refused(Bench(slide={"abort_write": {(0x1A00, 1): 0x06040041}}))

    assert (error.drive, error.place, error.value) == ("right/slide", "1A00h:01", "60410010h")
    assert "06040041h" in error.reason
    assert "cannot be mapped" in error.reason


def test_a_setting_that_reads_back_differently_is_refused():
    bench = Bench(hip={"ignore_write": {(0x605A, 0)}})
    bench.hip.values[0x605A, 0] = 2

    error = refused(bench)

    assert (error.place, error.value) == ("605Ah:00", "6")
    assert "reads back 2" in error.reason


@pytest.mark.parametrize(
    ("raw", "words"), [(0, "no motor data"), (278_680 * 2, "1 %"), (279, "1 %"), (275_000, "1 %")]
)
def test_a_torque_base_of_zero_or_more_than_one_percent_off_is_refused(raw, words):
    bench = Bench()
    bench.hip.values[0x6076, 0] = raw

    error = refused(bench)

    assert error.place == "6076h:00"
    assert words in error.reason


def test_the_torque_base_is_compared_and_never_written():
    bench = Bench()

    bench.run()

    assert not [w for w in bench.hip.written if w[:2] in {(0x6076, 0), (0x3001, 1), (0x3001, 5)}]


def test_a_drive_without_cyclic_synchronous_torque_is_refused():
    bench = Bench()
    bench.hip.values[0x6502, 0] = 0x6D

    assert refused(bench).place == "6502h:00"


def test_tpdos_of_another_length_than_mapped_are_refused():
    bench = Bench(hip={"short_tpdo": {2}})

    with pytest.raises(BringUpRefused, match="TPDO2 has 7 bytes instead of the 8"):
        bench.run()
    assert not bench.touched_power()


# --- silence --------------------------------------------------------------------------------------


# --- SDO hazards ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "stale",
    [
        "6065600000000000",  # download reply for another object
        "4318100104000000",  # upload reply for another object
        "8000200000000406",  # abort of another object
        "6017",  # no SDO frame at all
    ],
)
def test_a_late_reply_to_an_earlier_request_is_not_taken_for_the_answer(stale):
    frame = Frame(0x585, bytes.fromhex(stale))
    bench = Bench(hip={"stale_reply": {(0x1000, 0): frame, (0x6080, 0): frame}})

    assert bench.run()


def test_an_upload_reply_for_the_same_object_does_not_acknowledge_a_write():
    late = Frame(0x585, bytes.fromhex("43 80 60 00 01 00 00 00"))
    bench = Bench(hip={"mute": {(0x6080, 0)}, "stale_reply": {(0x6080, 0): late}})

    assert "6080h:00" in str(silent(bench))


def test_a_transfer_that_times_out_is_aborted_with_its_own_object():
    bench = Bench(hip={"mute": {(0x6065, 0)}})

    silent(bench)

    assert bench.sent(0x605)[-1] == bytes.fromhex("80 65 60 00 00 00 04 05")


def test_bus_off_during_bring_up_is_the_bus_s_fault_not_the_drive_s():
    bench = Bench()
    bench.bus.put(Frame(0x040, bytes(8), is_error=True), 20 * MS)

    with pytest.raises(BusError, match="bus-off"):
        bench.run()
    assert bench.port.bus_state.condition is BusCondition.OFF


def test_a_bus_that_takes_no_frames_is_reported_and_not_waited_for():
    bench = Bench()
    bench.bus.send_urgent = lambda frames, deadline_ns, clock: len(frames)

    with pytest.raises(BusError, match="transmit queue"):
        bench.run()


# --- SYNC -----------------------------------------------------------------------------------------


def with_sync_objects(bench, **flags):
    """The hip's drive has 1019h and 1007h, and its profile says so."""
    profile = drive("hip_epos4").profile
    has = msgspec.structs.replace(profile.optional_objects, **flags)
    profile = msgspec.structs.replace(profile, optional_objects=has)
    description = dataclasses.replace(drive("hip_epos4"), profile=profile)
    for place, bits in (((0x1019, 0), 8), ((0x1007, 0), 32)):
        bench.hip.values[place] = 99
        bench.hip.kinds[place] = (bits, False, "rw")
    cycle = CYCLE._replace(sync_counter=10, sync_window_us=8000)
    bench.plans = (plan(description, HIP_LIMITS, cycle), bench.plans[1])
    return bench


# --- what an earlier master has left in a drive ---------------------------------------------------

OFFSETS = {(0x60B0, 0): 2000, (0x60B1, 0): -7, (0x60B2, 0): 30}
"""Added to the targets of position, velocity and torque."""


@pytest.mark.parametrize("kind", ["epos4", "generic", "elmo"])
def test_offsets_of_the_targets_are_cleared_and_read_back(kind):
    bench = Bench(kind)
    bench.hip.values |= OFFSETS

    bench.run()

    assert {place: bench.hip.values[place] for place in OFFSETS} == dict.fromkeys(OFFSETS, 0)


@pytest.mark.parametrize("kind", ["epos4", "generic", "elmo"])
@pytest.mark.parametrize("place", OFFSETS)
def test_an_offset_that_a_drive_keeps_is_refused_by_its_object(kind, place):
    bench = Bench(kind, hip={"stored": {place: OFFSETS[place]}, "ignore_write": {place}})

    assert refused(bench).place == f"{place[0]:04X}h:00"


@pytest.mark.parametrize("code", [0x0602_0000, 0x0609_0011])
@pytest.mark.parametrize("place", [*OFFSETS, (0x1800, 3), (0x1801, 5)])
def test_a_drive_without_such_an_object_has_nothing_to_clear(place, code):
    bench = Bench("generic", hip={"abort_read": {place: code}, "abort_write": {place: code}})

    assert len(bench.run()) == 2


def test_an_offset_that_cannot_be_read_for_another_reason_is_refused():
    bench = Bench(hip={"abort_read": {(0x60B0, 0): 0x0604_0043}})

    error = refused(bench)

    assert (error.drive, error.place) == ("right/hip", "60B0h:00")
    assert "06040043h" in error.reason


def test_nothing_that_would_step_a_joint_is_cleared_while_a_drive_has_power():
    bench = Bench(hip={"disabled_statusword": 0x0240})
    bench.hip.values |= {**OFFSETS, (0x6041, 0): 0x1637}

    with pytest.raises(DrivePowered):
        bench.run()
    assert bench.hip.values[0x60B0, 0] == 2000
    bench.run(may_switch_off=True)

    written = [index for index, _, _ in bench.hip.written]
    assert written.index(0x6040) < min(written.index(index) for index, _ in OFFSETS)


def test_counter_and_window_of_sync_are_written_where_the_drive_has_them():
    bench = with_sync_objects(Bench(), sync_counter=True, sync_window=True)

    bench.run()

    assert bench.hip.values[0x1019, 0] == 10
    assert bench.hip.values[0x1007, 0] == 8000


def test_what_an_earlier_master_left_in_1019h_and_1007h_is_cleared():
    bench = with_sync_objects(Bench(), sync_counter=True, sync_window=True)
    profile = bench.plans[0].description
    bench.plans = (plan(profile, HIP_LIMITS, CYCLE), bench.plans[1])

    bench.run()

    assert bench.hip.values[0x1019, 0] == 0
    assert bench.hip.values[0x1007, 0] == 0


def test_a_drive_without_them_is_not_asked_for_them():
    bench = with_sync_objects(Bench(), sync_counter=False, sync_window=False)

    bench.run()

    assert not [w for w in bench.hip.written if w[0] in (0x1007, 0x1019)]


def test_a_counter_that_the_drive_does_not_keep_is_refused():
    bench = with_sync_objects(Bench(), sync_counter=True)
    bench.hip.ignore_write = {(0x1019, 0)}

    error = refused(bench)

    assert (error.place, error.value) == ("1019h:00", "10")


def test_the_counter_runs_from_one_to_its_overflow_and_begins_again():
    sync = SyncProducer(3)

    assert [sync.frame().data for _ in range(5)] == [b"\1", b"\2", b"\3", b"\1", b"\2"]
    sync.restart()
    assert sync.frame() == Frame(0x080, b"\1")
    assert SyncProducer(0).frame() == Frame(0x080, b"")
