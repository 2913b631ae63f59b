"""SDO server and object dictionary: CiA 301 7.2.4 and the abort codes of canopen.md 5.5.8."""

import struct

import pytest

from sim_drives.canopen.aborts import AbortCode


def segments(bench, index, sub):
    """Segmented upload, by hand: the bytes, and how many segments carried them."""
    answer = bench.sdo(struct.pack("<BHB", 0x40, index, sub))
    assert answer[0] == 0x41
    size, data, toggle, count = int.from_bytes(answer[4:8], "little"), b"", 0, 0
    while True:
        answer = bench.sdo(bytes((0x60 | toggle,)))
        assert answer[0] & 0x10 == toggle
        data += answer[1 : 8 - (answer[0] >> 1 & 7)]
        count += 1
        toggle ^= 0x10
        if answer[0] & 1:
            assert len(data) == size
            return data, count


def download(bench, index, sub, data, *, announced=None):
    """Segmented download, by hand: the last answer."""
    size = len(data) if announced is None else announced
    answer = bench.sdo(struct.pack("<BHBI", 0x21, index, sub, size))
    parts = [data[at : at + 7] for at in range(0, len(data), 7)]
    for number, part in enumerate(parts):
        if answer[0] == 0x80:
            return answer
        last = number == len(parts) - 1
        command = (number % 2) << 4 | (7 - len(part)) << 1 | last
        answer = bench.sdo(bytes((command,)) + part)
    return answer


def abort_code(answer, index, sub):
    assert answer[0] == 0x80
    assert struct.unpack("<HB", answer[1:4]) == (index, sub)
    return int.from_bytes(answer[4:8], "little")


def test_the_identity_is_what_the_eds_says_and_the_serial_number_is_the_drives_own(bench):
    assert [bench.read(0x1018, sub) for sub in range(1, 5)] == [
        0xFB,
        0x61500000,
        0x01700000,
        305_000_005,
    ]
    assert bench.read(0x1018, 4, node_id=6) == 305_000_006


@pytest.mark.parametrize(
    ("index", "sub", "value", "size", "code"),
    [
        (0x5FFF, 0, 0, 1, 0x06020000),
        (0x1018, 9, 0, 4, 0x06090011),
        (0x6041, 0, 0, 2, 0x06010002),
        (0x1018, 1, 0, 4, 0x06010002),
        (0x30B2, 0, 30_001, 2, 0x06090031),
        (0x6085, 0, 0, 4, 0x06090032),
        (0x605A, 0, 2, 2, 0x06090030),
        (0x605A, 0, 7, 2, 0x06090030),
        (0x6007, 0, 4, 2, 0x06090030),
        (0x60C2, 1, 101, 1, 0x06090031),
        (0x6060, 0, 7, 1, 0x06090030),
        (0x6060, 0, 6, 1, 0x06090030),
        (0x6098, 0, 5, 1, 0x06090030),
        (0x1010, 1, 0x12345678, 4, 0x08000020),
        (0x1011, 1, 0x65766173, 4, 0x08000020),
        (0x1005, 0, 0x40000080, 4, 0x06010002),
        (0x1003, 0, 1, 1, 0x06090030),
        (0x6065, 0, 1, 2, 0x06070013),
        (0x6060, 0, 8, 4, 0x06070012),
    ],
)
def test_a_write_that_is_not_allowed_is_aborted_with_its_reason_and_its_address(
    bench, index, sub, value, size, code
):
    assert bench.write(index, sub, value, size) == code


def test_reading_what_is_not_there_is_aborted(bench):
    assert bench.read_abort(0x5FFF) == 0x06020000
    assert bench.read_abort(0x6064, 1) == 0x06090011


def test_a_refused_write_changes_nothing(bench):
    before = bench.read(0x6085)

    bench.write(0x6085, 0, 0, 4)

    assert bench.read(0x6085) == before


def test_the_boundaries_of_a_range_are_allowed(bench):
    assert bench.write(0x6085, 0, 1, 4) == 0
    assert bench.write(0x6085, 0, 0xFFFFFFFF, 4) == 0


def test_a_download_of_another_length_than_announced_is_not_stored(generic):
    answer = download(generic, 0x2000, 0, b"0123456789", announced=11)

    assert abort_code(answer, 0x2000, 0) == 0x06070010
    assert segments(generic, 0x2000, 0) == (b"", 1)


def test_a_string_that_does_not_fit_is_out_of_memory(generic):
    answer = download(generic, 0x2000, 0, bytes(300))

    assert abort_code(answer, 0x2000, 0) == AbortCode.OUT_OF_MEMORY


def test_a_segment_that_belongs_to_no_transfer_is_aborted(bench):
    bench.read(0x6064)

    assert abort_code(bench.sdo(bytes((0x60,))), 0x6064, 0) == 0x05040001


def test_an_unknown_command_is_aborted_with_the_address_that_was_asked_for(bench):
    answer = bench.sdo(struct.pack("<BHBI", 0xE0, 0x1008, 0, 100))

    assert abort_code(answer, 0x1008, 0) == 0x05040001
    assert bench.read(0x1018, 1) == 0xFB


def test_a_length_that_a_number_cannot_have_is_refused_when_it_is_announced(bench):
    too_long = bench.sdo(struct.pack("<BHBI", 0x21, 0x6065, 0, 5))
    too_short = bench.sdo(struct.pack("<BHBI", 0x21, 0x6065, 0, 3))

    assert abort_code(too_long, 0x6065, 0) == 0x06070012
    assert abort_code(too_short, 0x6065, 0) == 0x06070013


def test_a_stopped_node_forgets_a_transfer_without_a_word(bench):
    bench.sdo(struct.pack("<BHB", 0x40, 0x1008, 0))
    bench.nmt(0x02)
    bench.forget()
    bench.run_ms(2000)
    assert bench.frames(0x585) == []

    bench.nmt(0x80)
    assert abort_code(bench.sdo(bytes((0x60,))), 0x1008, 0) == 0x05040001


@pytest.mark.parametrize("request_bytes", [b"", b"\x40\x18\x10\x01", b"\x40" * 7])
def test_a_request_that_is_not_eight_bytes_long_is_not_answered(bench, request_bytes):
    assert bench.ask(0x605, request_bytes) == []


def test_an_expedited_download_without_a_size_takes_the_objects_own(bench):
    answer = bench.sdo(struct.pack("<BHBI", 0x22, 0x1017, 0, 0x0001_0032))

    assert answer[0] == 0x60
    assert bench.read(0x1017) == 50


def test_motor_data_and_saving_are_refused_while_the_power_stage_is_on(bench):
    bench.go_operational()
    bench.enable()

    assert bench.write(0x3001, 1, 4000, 4) == 0x08000022
    assert bench.write(0x3001, 2, 11000, 4) == 0
    assert bench.write(0x1010, 1, 0x65766173, 4) == 0x08000022
