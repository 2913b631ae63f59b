"""What fails in bringing up a drive has a name, and a letter where CiA 302-2 has one.

The letters are compared with the table of Lely's CANopen library, typed off by hand.
"""

import pytest
from bringup_bench import START, Bench, refused, silent
from memory_bus import MS

from drives.canopen.bus import Frame
from drives.errors import BootFailure

LELY = {
    "B": "no response to 1000h",
    "C": "device type, 1F84h",
    "D": "vendor, 1F85h",
    "E": "no heartbeat in the check of the node's state",
    "J": "configuration download failed",
    "K": "no heartbeat when error control was started",
    "M": "product code, 1F86h",
    "N": "revision number, 1F87h",
    "O": "serial number, 1F88h",
}
NODE_HEARTBEAT = Frame(0x701, b"\x05")


def test_every_letter_is_the_standard_s_and_stands_for_one_failure():
    letters = [failure.letter for failure in BootFailure if failure.letter]

    assert sorted(letters) == sorted(LELY)


@pytest.mark.parametrize("failure", BootFailure)
def test_a_failure_reads_as_words_with_its_letter(failure):
    assert failure.value in str(failure)
    assert (f"(CiA 302 {failure.letter})" in str(failure)) == bool(failure.letter)


# --- refused: another try would say the same ------------------------------------------------------


@pytest.mark.parametrize(
    ("place", "stored", "failure"),
    [
        ((0x1000, 0), 0x0002_0191, BootFailure.WRONG_DEVICE_TYPE),
        ((0x1018, 1), 0x0000_009A, BootFailure.WRONG_VENDOR),
        ((0x1018, 2), 0x6551_0000, BootFailure.WRONG_PRODUCT),
        ((0x1018, 3), 0x0160_0000, BootFailure.WRONG_REVISION),
    ],
    ids=["device type", "vendor", "product", "revision"],
)
def test_a_drive_that_is_another_one_is_refused_with_what_was_expected_and_found(
    place, stored, failure
):
    bench = Bench(hip={"stored": {place: stored}})

    error = refused(bench)

    assert error.failure is failure
    assert error.drive == "right/hip"
    assert error.place == f"{place[0]:04X}h:{place[1]:02X}"
    assert "expected" in error.reason
    assert failure.value in str(error)
    assert bench.slide.nmt_state == 0x7F


def test_a_drive_with_another_serial_number_than_the_file_s_is_refused():
    bench = Bench(hip={"stored": {(0x1018, 4): 7}}, serial=8)

    error = refused(bench)

    assert error.failure is BootFailure.WRONG_SERIAL_NUMBER
    assert "00000007h" in error.value
    assert "00000008h" in error.reason


def test_a_drive_without_the_modes_that_we_use_is_refused():
    bench = Bench()
    bench.hip.values[0x6502, 0] = 0x6D

    assert refused(bench).failure is BootFailure.MISSING_MODE


def test_a_drive_with_other_motor_data_is_refused():
    bench = Bench()
    bench.hip.values[0x6076, 0] = 0

    assert refused(bench).failure is BootFailure.WRONG_MOTOR_DATA


def test_a_mapping_that_is_refused_fails_the_configuration_and_a_later_try_works():
    bench = Bench(hip={"abort_write": {(0x1A00, 1): 0x0604_0041}})

    error = refused(bench)

    assert error.failure is BootFailure.CONFIGURATION
    assert (error.place, error.value) == ("1A00h:01", "60410010h")
    assert "06040041h" in error.reason
    bench.hip.abort_write.clear()
    assert bench.run()


def test_a_command_pdo_that_the_drive_keeps_event_driven_is_refused_with_the_reason():
    place = (0x1400, 2)
    error = refused(Bench(hip={"stored": {place: 255}, "ignore_write": {place}}))

    assert error.failure is BootFailure.CONFIGURATION
    assert (error.place, error.value) == ("1400h:02", "1")
    assert "reads back 255" in error.reason
    assert "RPDO1" in error.reason
    assert "SYNC" in error.reason


@pytest.mark.parametrize(("sub", "kept"), [(1, 50), (2, -2)])
def test_an_interpolation_time_that_is_not_the_sync_period_is_refused(sub, kept):
    place = (0x60C2, sub)
    bench = Bench(hip={"ignore_write": {place}})
    bench.hip.values[place] = kept

    error = refused(bench)

    assert error.failure is BootFailure.CONFIGURATION
    assert error.place == f"60C2h:0{sub}"
    assert f"reads back {kept}" in error.reason


# --- two nodes under one number -------------------------------------------------------------------


@pytest.mark.parametrize("place", [(0x1000, 0), (0x1018, 2), (0x1018, 4), (0x1A01, 2), (0x6085, 0)])
def test_two_nodes_under_one_number_are_refused_when_a_request_is_answered_twice(place):
    error = refused(Bench(slide={"answers_twice": {place}}))

    assert error.failure is BootFailure.DUPLICATE_NODE
    assert error.drive == "right/slide"
    assert "node 6" in error.reason


def test_two_nodes_under_one_number_are_refused_when_the_serial_number_changes():
    error = refused(Bench(hip={"serials": (0x1111, 0x2222)}))

    assert error.failure is BootFailure.DUPLICATE_NODE
    assert "00001111h" in error.reason
    assert "00002222h" in error.reason


def test_a_second_boot_up_after_the_first_has_settled_is_asked_who_it_was():
    asked_once_more = {"serials": (0x1111, 0x1111, 0x1111, 0x2222)}

    error = refused(Bench(hip=asked_once_more | {"extra_boots_ns": (200 * MS,)}))

    assert error.failure is BootFailure.DUPLICATE_NODE
    assert Bench(hip=asked_once_more).run()


def test_a_drive_without_a_serial_number_is_brought_up():
    bench = Bench()
    for node in (bench.hip, bench.slide):
        node.abort_read = {(0x1018, 4): 0x0609_0011}

    assert bench.run()


# --- silent: worth another try --------------------------------------------------------------------


def test_a_drive_without_power_does_not_answer():
    assert silent(Bench(slide={"dead": True})).failure is BootFailure.NO_ANSWER


def test_a_drive_that_boots_and_does_not_say_what_it_is_does_not_answer():
    error = silent(Bench(hip={"mute": {(0x1000, 0)}}))

    assert error.failure is BootFailure.NO_ANSWER
    assert "1000h:00" in error.what


def test_a_drive_that_falls_silent_over_a_setting_fails_its_configuration():
    assert silent(Bench(hip={"mute": {(0x6065, 0)}})).failure is BootFailure.CONFIGURATION


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x020, bytes(8), is_error=True),
        Frame(0x008, b"\0\0\0\x19\0\0\0\0", is_error=True),
        Frame(0x004, b"\0\x20\0\0\0\0\0\0", is_error=True),
    ],
    ids=["acknowledge error", "protocol error in the acknowledge slot", "transmitter passive"],
)
def test_without_any_acknowledgement_it_is_said_that_no_other_node_is_on_the_bus(frame):
    bench = Bench(hip={"dead": True}, slide={"dead": True})
    bench.bus.put(frame, 1 * MS)

    error = silent(bench)

    assert error.failure is BootFailure.NO_NODE
    assert "no other node is on the bus" in str(error)


def test_a_drive_whose_heartbeat_never_comes_is_named():
    assert silent(Bench(hip={"no_heartbeat": True})).failure is BootFailure.NO_HEARTBEAT


def test_a_drive_that_is_not_where_nmt_has_put_it_is_in_the_wrong_state():
    error = silent(Bench(slide={"never_operational": True}))

    assert error.failure is BootFailure.WRONG_STATE
    assert error.drive == "right/slide"


def test_a_drive_that_sends_no_samples_is_named():
    assert silent(Bench(slide={"without_tpdo": {2}})).failure is BootFailure.NO_SAMPLES


def test_a_drive_that_reboots_while_it_is_configured_is_named_and_not_started():
    bench = Bench(hip={"reboot_on_write": (0x6080, 0)})

    assert silent(bench).failure is BootFailure.REBOOTED
    assert START not in [data[:1] for data in bench.sent(0)]


@pytest.mark.parametrize("frame", [NODE_HEARTBEAT, Frame(0x701, b"\x00"), Frame(0x080, b"")])
def test_another_master_on_the_bus_is_found_and_no_drive_is_started_beside_it(frame):
    bench = Bench()
    bench.bus.put(frame, 100 * MS)

    error = silent(bench)

    assert error.failure is BootFailure.FOREIGN_MASTER
    assert error.drive == ""
    assert START not in [data[:1] for data in bench.sent(0)]


def test_beside_another_master_nothing_is_sent_at_all_not_even_the_reset():
    bench = Bench()
    bench.bus.put(Frame(0x080, b""), 90 * MS)

    assert silent(bench).failure is BootFailure.FOREIGN_MASTER
    assert not [bench.sent(node) for node in (0, 0x605, 0x606) if bench.sent(node)]


def test_a_master_that_has_gone_before_we_came_is_none():
    bench = Bench()
    bench.bus.put(NODE_HEARTBEAT)
    bench.bus.put(Frame(0x080, b""))

    assert bench.run()
