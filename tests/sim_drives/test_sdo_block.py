"""SDO block transfer by raw frames: CiA 301 7.2.4.3.9 to 15, S13 of canopen.md 6.2."""

import random
import struct

import pytest
from drive_bench import GENERIC, Bench
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_drives.canopen.sdo_block import crc

MEMORY = 0x2010
TEN_KB = random.Random(1).randbytes(10_000)
SPACING_MS = 0.2


@pytest.fixture
def bench(generic):
    """An EPOS4 has no object of this size that can be written."""
    return generic


def initiate(bench, command, size=0, index=MEMORY, sub=0):
    return bench.sdo(struct.pack("<BHBI", command, index, sub, size))


def code_of(answer, index=MEMORY, sub=0):
    assert answer[:4] == struct.pack("<BHB", 0x80, index, sub)
    return int.from_bytes(answer[4:8], "little")


def pieces(data):
    return [data[at : at + 7] for at in range(0, len(data), 7)] or [b""]


def tell(bench, request):
    """A request of eight bytes; what the server says at once."""
    return [timed.data for timed in bench.ask(0x605, request.ljust(8, b"\0"))]


def free(bench):
    """Whether the server serves something else as if nothing had been."""
    return bench.read(0x1018, 1) == 0x29A


# --- download -----------------------------------------------------------------------------------


def send_sub_block(bench, parts, *, last, lost=()):
    """Segments 1, 2, ... of these parts without the lost ones; the acknowledged number."""
    answers = []
    for number, part in enumerate(parts, 1):
        if number not in lost:
            ends = last and number == len(parts)
            answers += tell(bench, bytes((ends << 7 | number,)) + part)
    assert len(answers) == 1
    assert answers[0][0] == 0xA2
    assert answers[0][2] == 127
    return answers[0][1]


def send_blocks(bench, data, losing=lambda count: ()):
    """All segments, those that got lost again; how many sub-blocks it took."""
    rest, count = pieces(data), 0
    while rest:
        parts = rest[:127]
        last, lost = len(parts) == len(rest), losing(len(parts))
        rest = rest[send_sub_block(bench, parts, last=last, lost=lost) :]
        count += 1
    return count


def end_of(data, *, crc_sent=None):
    unused = -len(data) % 7 if data else 7
    return struct.pack("<BH", 0xC1 | unused << 2, crc(data) if crc_sent is None else crc_sent)


def download(bench, data, **kwargs):
    assert initiate(bench, 0xC6, len(data))[0:5] == struct.pack("<BHBB", 0xA4, MEMORY, 0, 127)
    count = send_blocks(bench, data, **kwargs)
    assert tell(bench, end_of(data)) == [b"\xa1" + bytes(7)]
    return count


# --- upload -------------------------------------------------------------------------------------


def hear(bench, request):
    """All that the server says until it waits again."""
    bench.forget()
    bench.send(0x605, request.ljust(8, b"\0"))
    bench.run_ms(127 * SPACING_MS)
    return bench.frames(0x585)


def start_upload(bench, size, block_size=127):
    answer = initiate(bench, 0xA4, block_size)
    assert answer == struct.pack("<BHBI", 0xC6, MEMORY, 0, size)


def upload(bench, size, *, block_size=127, lose=lambda _: 0):
    """The data; of a sub-block of `count` segments, the last `lose(count)` are not received."""
    start_upload(bench, size, block_size)
    data, frames = b"", hear(bench, b"\xa3")
    while frames[0][0] & 0x7F == 1:
        assert [frame[0] & 0x7F for frame in frames] == list(range(1, len(frames) + 1))
        assert len(frames) <= block_size
        got = len(frames) - lose(len(frames))
        data += b"".join(frame[1:] for frame in frames[:got])
        frames = hear(bench, bytes((0xA2, got, block_size)))
    [(command, checksum)] = [struct.unpack("<BH", frame[:3]) for frame in frames]
    assert command & 0xE3 == 0xC1
    data = data[: len(data) - (command >> 2 & 7)]
    assert checksum == crc(data)
    assert hear(bench, b"\xa1") == []
    return data


# --- whole transfers ----------------------------------------------------------------------------


def test_the_check_sum_is_the_one_of_the_standard():
    assert crc(b"123456789") == 0x31C3  # CRC-16/XMODEM's check value


@settings(derandomize=True, max_examples=10, deadline=None)
@given(st.binary(max_size=500), st.integers(1, 127), st.randoms(use_true_random=False))
def test_whatever_gets_lost_is_sent_again_and_arrives(data, block_size, rng):
    bench = Bench(hip=GENERIC)
    bench.boot()

    download(bench, data, losing=lambda count: rng.sample(range(1, count), min(3, count - 1)))

    assert upload(bench, len(data), block_size=block_size, lose=rng.randrange) == data
    assert free(bench)


def test_a_lost_segment_costs_one_more_sub_block(bench):
    lost = iter([(2, 50)] + [()] * 100)

    assert download(bench, TEN_KB, losing=lambda _: next(lost)) == 13
    assert upload(bench, len(TEN_KB)) == TEN_KB


def test_without_check_sums_the_data_are_taken_as_they_are(bench):
    assert initiate(bench, 0xC2, 20)[0] == 0xA4
    send_blocks(bench, TEN_KB[:20])
    assert tell(bench, end_of(TEN_KB[:20], crc_sent=0xBAD))[0][0] == 0xA1

    answer = initiate(bench, 0xA0, 127)
    assert answer[0] == 0xC6
    hear(bench, b"\xa3")
    assert hear(bench, b"\xa2\x03\x7f") == [b"\xc5" + bytes(7)]


def test_a_number_travels_in_a_block_too(bench):
    assert initiate(bench, 0xC6, 4, index=0x6065)[0] == 0xA4
    send_blocks(bench, (4321).to_bytes(4, "little"))
    assert tell(bench, end_of((4321).to_bytes(4, "little")))[0][0] == 0xA1

    assert bench.read(0x6065) == 4321


def test_up_to_the_threshold_the_server_changes_to_the_ordinary_upload(bench):
    name = b"Virtual CiA 402 drive"

    switched = initiate(bench, 0xA4, 127 | len(name) << 8, index=0x1008)
    assert switched == struct.pack("<BHBI", 0x41, 0x1008, 0, len(name))
    assert tell(bench, b"\x60") == [b"\x00" + name[:7]]
    expedited = initiate(bench, 0xA4, 127 | 4 << 8, index=0x1018, sub=1)
    assert expedited == struct.pack("<BHBI", 0x43, 0x1018, 1, 0x29A)

    stays = initiate(bench, 0xA4, 127 | len(name) - 1 << 8, index=0x1008)
    assert stays[0] == 0xC6


# --- what goes wrong ----------------------------------------------------------------------------


def test_nothing_is_stored_before_the_end_has_been_said(bench):
    initiate(bench, 0xC6, 7)
    send_blocks(bench, b"1234567")
    tell(bench, struct.pack("<BHBI", 0x80, MEMORY, 0, 0x08000000))

    assert upload(bench, 0) == b""


def test_another_length_than_announced_is_aborted(bench):
    initiate(bench, 0xC6, 101)
    send_blocks(bench, bytes(100))

    assert code_of(tell(bench, end_of(bytes(100)))[0]) == 0x06070010
    assert free(bench)


def test_more_than_there_is_room_for_is_aborted_at_once_or_when_it_comes(bench):
    assert code_of(initiate(bench, 0xC6, 32_769)) == 0x05040005

    assert initiate(bench, 0xC4)[0] == 0xA4
    answers = []
    for number in range(32_768 // 7 + 2):
        answers += tell(bench, bytes((number % 127 + 1,)) + bytes(7))
    assert code_of(answers[-1]) == 0x05040005
    assert free(bench)


@pytest.mark.parametrize(
    ("index", "sub", "code"),
    [(0x5FFF, 0, 0x06020000), (0x1018, 9, 0x06090011), (0x1008, 0, 0x06010002)],
)
def test_a_download_that_is_not_allowed_is_refused_at_its_beginning(bench, index, sub, code):
    assert code_of(initiate(bench, 0xC6, 4, index, sub), index, sub) == code


def test_a_value_out_of_range_is_refused_at_its_end(bench):
    initiate(bench, 0xC6, 4, index=0x6085)
    send_blocks(bench, bytes(4))

    assert code_of(tell(bench, end_of(bytes(4)))[0], 0x6085) == 0x06090032


@pytest.mark.parametrize("block_size", [0, 128, 255])
def test_a_block_size_that_cannot_be_is_refused(bench, block_size):
    assert code_of(initiate(bench, 0xA4, block_size)) == 0x05040002

    download(bench, TEN_KB[:30])
    start_upload(bench, 30)
    hear(bench, b"\xa3")
    assert code_of(hear(bench, bytes((0xA2, 5, block_size)))[0]) == 0x05040002
    assert free(bench)


def test_a_segment_numbered_zero_is_refused(bench):
    initiate(bench, 0xC6, 100)

    assert code_of(tell(bench, bytes(8))[0]) == 0x05040003
    assert free(bench)


def test_more_acknowledged_than_was_sent_is_refused(bench):
    download(bench, TEN_KB[:30])
    start_upload(bench, 30)
    hear(bench, b"\xa3")

    assert code_of(hear(bench, b"\xa2\x06\x7f")[0]) == 0x05040003
    assert free(bench)


@pytest.mark.parametrize("request_bytes", [b"\xa2\x01\x7f", b"\xa1", b"\x60", b"\x00", b"\xc1"])
def test_a_step_out_of_turn_is_refused(bench, request_bytes):
    download(bench, TEN_KB[:30])
    start_upload(bench, 30)

    assert code_of(hear(bench, request_bytes)[0]) == 0x05040001
    assert free(bench)


def test_a_sub_block_that_is_never_acknowledged_is_given_up_after_a_second(bench):
    download(bench, TEN_KB[:30])
    start_upload(bench, 30)
    assert len(hear(bench, b"\xa3")) == 5

    bench.forget()
    bench.run_ms(1000)

    assert [code_of(frame) for frame in bench.frames(0x585)] == [0x05040000]


def test_a_clients_abort_ends_a_block_of_either_way_at_once(bench):
    abort = struct.pack("<BHBI", 0x80, MEMORY, 0, 0x08000000)
    initiate(bench, 0xC6, 10_000)
    for number in range(1, 60):
        assert tell(bench, bytes((number,)) + bytes(7)) == []
    assert hear(bench, abort) == []
    assert free(bench)

    download(bench, TEN_KB)
    start_upload(bench, len(TEN_KB))
    bench.ask(0x605, b"\xa3".ljust(8, b"\0"))
    bench.run_ms(10)
    assert hear(bench, abort) == []
    assert free(bench)


def test_a_stopped_node_sends_no_more_segments(bench):
    download(bench, TEN_KB)
    start_upload(bench, len(TEN_KB))
    bench.ask(0x605, b"\xa3".ljust(8, b"\0"))
    bench.nmt(0x02)
    bench.forget()

    bench.run_ms(3000)

    assert bench.frames(0x585) == []


def test_what_is_in_the_user_memory_is_saved_with_the_other_parameters(bench):
    download(bench, TEN_KB)
    assert bench.write(0x1010, 1, int.from_bytes(b"save", "little"), 4) == 0
    bench.nmt(0x81)
    bench.run_ms(400)

    assert upload(bench, len(TEN_KB)) == TEN_KB
