"""The SDO server against transfers and garbage in any order: never a wrong answer, never stuck.

The machine plays clients of all three kinds and remembers what the objects must hold. Frames of
which it cannot know the effect are random; after those it looks what the objects hold, and only
asks that nothing illegal is in them.
"""

import struct
from typing import ClassVar

from drive_bench import entries_of
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from drives.canopen.frame import Frame
from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.dictionary import ObjectDictionary
from sim_drives.canopen.sdo_block import crc
from sim_drives.canopen.sdo_server import SdoServer
from sim_drives.canopen.timers import MILLISECOND, Timers

LABEL, MEMORY = (0x2000, 0), (0x2010, 0)
NUMBERS = {(0x1017, 0): 2, (0x6085, 0): 4, (0x605A, 0): 2, (0x6007, 0): 2}
ADDRESSES = [LABEL, MEMORY, *NUMBERS]
ABORT_CODES = {0x05030000, *range(0x05040000, 0x05040006), 0x06010001, 0x06010002, 0x06020000}
ABORT_CODES |= {0x06070010, 0x06070012, 0x06070013, 0x06090011, 0x06090031, 0x06090032}


class OwnLine:
    """A bus on which only the server speaks."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.said: list[bytes] = []

    def send(self, frame: Frame, *, delay_ns: int = 0) -> None:
        assert (frame.can_id, len(frame.data), delay_ns) == (0x585, 8, 0)
        self.said.append(frame.data)


def pieces(data):
    return [data[at : at + 7] for at in range(0, len(data), 7)] or [b""]


class AnyOrder(RuleBasedStateMachine):
    """One server, one client that may do anything."""

    addresses: ClassVar = st.sampled_from(ADDRESSES)
    data: ClassVar = (
        st.binary(max_size=6) | st.binary(max_size=300) | st.binary(min_size=880, max_size=1000)
    )
    noise: ClassVar = st.lists(st.binary(max_size=7), max_size=2)

    def __init__(self):
        super().__init__()
        self.line, self.timers = OwnLine(), Timers()
        self.entries = {e.address: e for e in entries_of("drives/generic402.eds", 5)}
        self.dictionary = ObjectDictionary(tuple(self.entries.values()))
        self.server = SdoServer(5, NodeContext(self.dictionary, self.line, self.timers))
        self.held = {a: self.entries[a].encode(self.entries[a].default) for a in ADDRESSES}
        self.between: list[bytes] = []

    # --- the client's hand --------------------------------------------------------------------

    def tell(self, request):
        """What the server says to one request, and to the noise before it."""
        self.line.said.clear()
        for noise in self.between:
            self.server.receive(noise)
        self.server.receive(request.ljust(8, b"\0"))
        return list(self.line.said)

    def ask(self, request):
        [answer] = self.tell(request)
        return answer

    def wait(self, duration_ms):
        end_ns = self.line.now_ns + round(duration_ms * MILLISECOND)
        while self.timers.next_ns <= end_ns:
            self.line.now_ns = self.timers.next_ns
            self.timers.run_due(self.line.now_ns)
        self.line.now_ns = end_ns

    def head(self, command, address, payload=b""):
        return struct.pack("<BHB", command, *address) + payload.ljust(4, b"\0")

    def abort(self, address):
        assert self.tell(self.head(0x80, address, b"\0\0\0\x08")) == []

    def aborted(self, answer, address):
        """The code, if the answer is an abort."""
        if answer[0] != 0x80:
            return None
        assert answer[1:4] == self.head(0, address)[1:4]
        code = int.from_bytes(answer[4:8], "little")
        assert code in ABORT_CODES, hex(code)
        return code

    # --- whole transfers ------------------------------------------------------------------------

    def expected_code(self, address, data):
        """What becomes of writing these bytes."""
        entry = self.entries[address]
        if not entry.type_code:
            return 0x05040005 if len(data) > entry.max_bytes else None
        if len(data) != entry.size_bytes:
            return 0x06070012 if len(data) > entry.size_bytes else 0x06070013
        value = struct.unpack("<" + entry.type_code, data)[0]
        if entry.high is not None and value > entry.high:
            return 0x06090031
        return 0x06090032 if entry.low is not None and value < entry.low else None

    def written(self, address, data, code):
        assert code == self.expected_code(address, data)
        if code is None:
            self.held[address] = data

    @rule(address=addresses, data=st.binary(min_size=1, max_size=4), noise=noise)
    def write_at_once(self, address, data, noise):
        self.between = noise
        answer = self.ask(self.head(0x23 | (4 - len(data)) << 2, address, data))
        self.written(address, data, self.aborted(answer, address))

    @rule(address=addresses, data=data, says_size=st.booleans(), noise=noise)
    def write_in_segments(self, address, data, says_size, noise):
        self.between = noise
        code = self.send_segments(address, data, says_size=says_size)
        self.written(address, data, code)

    def send_segments(self, address, data, *, says_size, steps=None):
        """Up to `steps` of the transfer; the abort code that ended it."""
        size = len(data).to_bytes(4, "little") if says_size else b""
        answer = self.ask(self.head(0x20 | says_size, address, size))
        for number, part in enumerate(pieces(data)[:steps]):
            code = self.aborted(answer, address)
            if code is not None:
                return code
            last = number == len(pieces(data)) - 1
            answer = self.ask(bytes((number % 2 << 4 | 7 - len(part) << 1 | last,)) + part)
        return self.aborted(answer, address)

    @rule(address=addresses, data=data, says_size=st.booleans(), noise=noise)
    def write_in_blocks(self, address, data, says_size, noise):
        self.between = noise
        code = self.send_blocks(address, data, says_size=says_size)
        if code is None:
            end = struct.pack("<BH", 0xC1 | 7 - len(pieces(data)[-1]) << 2, crc(data))
            code = self.aborted(self.ask(end), address)
        self.written(address, data, code)

    def send_blocks(self, address, data, *, says_size, steps=None):
        """Up to `steps` segments; the abort code that ended it."""
        size = len(data).to_bytes(4, "little") if says_size else b""
        code = self.aborted(self.ask(self.head(0xC4 | says_size << 1, address, size)), address)
        if code is not None:
            return code
        for number, part in enumerate(pieces(data)[:steps]):
            last = number == len(pieces(data)) - 1
            answers = self.tell(bytes((last << 7 | number % 127 + 1,)) + part)
            if answers and self.aborted(answers[0], address):
                return self.aborted(answers[0], address)
            due = last or number % 127 == 126
            assert answers == [bytes((0xA2, number % 127 + 1, 127)) + bytes(5)] * due
        return None

    @rule(address=addresses, noise=noise)
    def read_at_once_or_in_segments(self, address, noise):
        self.between = noise
        assert self.receive_segments(address) == self.held[address]

    def receive_segments(self, address, steps=None):
        answer = self.ask(self.head(0x40, address))
        if answer[0] & 0xE3 == 0x43:
            return answer[4 : 8 - (answer[0] >> 2 & 3)]
        assert answer[:4] == self.head(0x41, address)[:4]
        size, data = int.from_bytes(answer[4:8], "little"), b""
        for number in range(len(pieces(bytes(size)))):
            if number == steps:
                break
            answer = self.ask(bytes((0x60 | number % 2 << 4,)))
            assert answer[0] & 0xF0 == number % 2 << 4
            data += answer[1 : 8 - (answer[0] >> 1 & 7)]
        return data

    @rule(address=addresses, block_size=st.integers(1, 127), noise=noise)
    def read_in_blocks(self, address, block_size, noise):
        self.between = noise
        answer = self.ask(self.head(0xA4, address, bytes((block_size,))))
        assert answer == self.head(0xC6, address, len(self.held[address]).to_bytes(4, "little"))
        data, request = b"", b"\xa3"
        while True:
            answers = self.tell(request)
            self.wait(127 * 0.2)
            answers = list(self.line.said)
            if answers[0][0] & 0x7F != 1:
                break
            assert [a[0] & 0x7F for a in answers] == list(range(1, len(answers) + 1))
            data += b"".join(answer[1:] for answer in answers)
            request = bytes((0xA2, len(answers), block_size))
        assert len(answers) == 1
        command, checksum = struct.unpack("<BH", answers[0][:3])
        data = data[: len(data) - (command >> 2 & 7)]
        assert (data, checksum) == (self.held[address], crc(data))
        assert self.tell(b"\xa1") == []

    # --- transfers that come to nothing ---------------------------------------------------------

    @rule(address=addresses, data=data, steps=st.integers(0, 140), block=st.booleans())
    def leave_a_write_unfinished(self, address, data, steps, block):
        """The next rule finds it so; only a sub-block has to be given up first."""
        self.between = []
        send = self.send_blocks if block else self.send_segments
        send(address, data, says_size=False, steps=min(steps, len(pieces(data)) - 1))
        if block:
            self.abort(address)

    @rule(address=addresses, steps=st.integers(0, 3))
    def leave_a_read_unfinished(self, address, steps):
        self.between = []
        self.receive_segments(address, steps)

    @rule(address=addresses, data=st.binary(min_size=20, max_size=60), block=st.booleans())
    def fall_silent(self, address, data, block):
        self.between = []
        send = self.send_blocks if block else self.send_segments
        code = send(address, data, says_size=False, steps=2)
        self.line.said.clear()
        self.wait(1000)
        assert [self.aborted(a, address) for a in self.line.said] == [0x05040000] * (code is None)

    @rule(data=st.binary(min_size=8, max_size=60), wrong=st.integers(1, 0xFFFF))
    def send_a_wrong_check_sum(self, data, wrong):
        self.between = []
        assert self.send_blocks(MEMORY, data, says_size=True) is None
        end = struct.pack("<BH", 0xC1 | 7 - len(pieces(data)[-1]) << 2, crc(data) ^ wrong)
        assert self.aborted(self.ask(end), MEMORY) == 0x05040004

    @rule(data=st.binary(min_size=20, max_size=60))
    def toggle_wrongly(self, data):
        self.between = []
        self.send_segments(MEMORY, data, says_size=False, steps=1)
        assert self.aborted(self.ask(b"\x00" + data[:7]), MEMORY) == 0x05030000

    @rule(frames=st.lists(st.binary(max_size=8) | st.binary(min_size=8, max_size=8), max_size=20))
    def send_anything(self, frames):
        self.line.said.clear()
        for frame in frames:
            self.server.receive(frame)
            self.wait(0.3)
        self.abort(MEMORY)
        for address in ADDRESSES:
            data = self.receive_segments(address)
            assert data == self.held[address] or self.expected_code(address, data) is None
            self.held[address] = data

    @rule(duration_ms=st.sampled_from([0.1, 1.0, 2000.0]))
    def do_nothing(self, duration_ms):
        self.wait(duration_ms)

    @invariant()
    def nothing_else_has_been_stored(self):
        for address, data in self.held.items():
            assert self.dictionary.upload(*address) == data


AnyOrder.TestCase.settings = settings(
    derandomize=True, max_examples=25, stateful_step_count=30, deadline=None
)
TestTheServerInAnyOrder = AnyOrder.TestCase
