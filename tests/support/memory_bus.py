"""A CAN bus in memory, in lock step: time moves only when a frame is waited for.

`ScriptedDrive` is a CANopen slave for tests of the master: written from CiA 301 and CiA 402 on raw
frames, strict about mapping, and ready to misbehave on order. Its dictionary is read from an EDS.
"""

import configparser
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

from drives.canopen.bus import Clock, Frame

MS = 1_000_000
WIDTHS = {1: 8, 2: 8, 5: 8, 3: 16, 6: 16, 4: 32, 7: 32, 9: 0}
SIGNED = {2, 3, 4}


class ManualClock:
    def __init__(self) -> None:
        self.time_ns = 1_000 * MS

    def now_ns(self) -> int:
        return self.time_ns


class MemoryBus:
    """A `Bus` whose other end are objects with `take(frame, now_ns)` and `due(now_ns)`."""

    def __init__(self, clock: ManualClock, nodes: Sequence["ScriptedDrive"]) -> None:
        self.clock = clock
        self.nodes = list(nodes)
        self.sent: list[Frame] = []
        self.coming: list[tuple[int, int, Frame]] = []
        self.count = 0
        self.idle_count = 0
        """Waits in a row in which nothing came and no time passed."""

    def put(self, frame: Frame, after_ns: int = 0) -> None:
        self.coming.append((self.clock.now_ns() + after_ns, self.count, frame))
        self.count += 1

    def send(self, frames: Sequence[Frame]) -> int:
        for frame in frames:
            self.sent.append(frame)
            for node in self.nodes:
                for reply, after_ns in node.take(frame, self.clock.now_ns()):
                    self.put(reply, after_ns)
        return 0

    def send_urgent(self, frames: Sequence[Frame], deadline_ns: int, clock: Clock) -> int:
        return self.send(frames)

    def drain(self) -> list[Frame]:
        now_ns = self.clock.now_ns()
        self._beat(now_ns)
        due = sorted(entry for entry in self.coming if entry[0] <= now_ns)
        self.coming = [entry for entry in self.coming if entry[0] > now_ns]
        return [frame for _, _, frame in due]

    def receive_until(self, deadline_ns: int, clock: Clock) -> list[Frame]:
        began_ns = self.clock.now_ns()
        while not (frames := self.drain()) and self.clock.now_ns() < deadline_ns:
            waits = [entry[0] for entry in self.coming]
            waits += [node.next_beat_ns for node in self.nodes if node.next_beat_ns is not None]
            self.clock.time_ns = max(self.clock.now_ns(), min([deadline_ns, *waits]))
        is_idle = not frames and self.clock.now_ns() == began_ns
        self.idle_count = self.idle_count + 1 if is_idle else 0
        assert self.idle_count < 100, "it waits without end: no time passes"
        return frames

    def close(self) -> None:
        pass

    def _beat(self, now_ns: int) -> None:
        for node in self.nodes:
            for frame in node.beats(now_ns):
                self.put(frame)


@cache
def objects_of(eds: str, node_id: int) -> dict[tuple[int, int], tuple[int, tuple[int, bool, str]]]:
    """Default, width, sign, access and mapping right of each object of an EDS, by a parser of the
    tests' own."""
    parser = configparser.ConfigParser(interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # keep the case
    parser.read(eds, encoding="utf-8")
    found = {}
    for section in parser.sections():
        name, _, sub = section.partition("sub")
        if not (len(name) == 4 and all(c in "0123456789ABCDEFabcdef" for c in name)):
            continue
        entry = parser[section]
        if "DataType" not in entry or WIDTHS.get(int(entry["DataType"], 0), 0) == 0:
            continue
        kind = int(entry["DataType"], 0)
        default = entry.get("DefaultValue", "0") or "0"
        value = sum(
            node_id if part.strip() == "$NODEID" else int(part, 0) for part in default.split("+")
        )
        key = (int(name, 16), int(sub or "0", 16))
        mappable = " mapped" if int(entry.get("PDOMapping", "0") or "0", 0) else ""
        found[key] = value, (WIDTHS[kind], kind in SIGNED, entry["AccessType"] + mappable)
    return found


@dataclass
class ScriptedDrive:
    """One slave. The fields below `behaviour` make it misbehave."""

    eds: str
    node_id: int
    nmt_state: int = 0x7F
    next_beat_ns: int | None = None
    values: dict[tuple[int, int], int] = field(default_factory=dict)
    kinds: dict[tuple[int, int], tuple[int, bool, str]] = field(default_factory=dict)
    written: list[tuple[int, int, int]] = field(default_factory=list)
    sync_count: int = 0
    stored: dict[tuple[int, int], int] = field(default_factory=dict)
    """What an object holds after power-on, where that is not the EDS's default."""
    # behaviour
    dead: bool = False
    boot_delay_ns: int = 5 * MS
    extra_boots_ns: tuple[int, ...] = ()
    reboot_on_write: tuple[int, int] | None = None
    abort_write: dict[tuple[int, int], int] = field(default_factory=dict)
    abort_read: dict[tuple[int, int], int] = field(default_factory=dict)
    ignore_write: set[tuple[int, int]] = field(default_factory=set)
    mute: set[tuple[int, int]] = field(default_factory=set)
    stale_reply: dict[tuple[int, int], Frame] = field(default_factory=dict)
    """Sent once, before the answer to the first request for the object."""
    answers_twice: set[tuple[int, int]] = field(default_factory=set)
    """Objects whose requests get a second answer, as from a second node."""
    serials: tuple[int, ...] = ()
    """Answers to 1018h:04 in turn, as from a second node."""
    never_operational: bool = False
    without_tpdo: set[int] = field(default_factory=set)
    short_tpdo: set[int] = field(default_factory=set)
    no_heartbeat: bool = False
    disabled_statusword: int | None = None
    """What it shows after disable voltage by SDO; None: it does not obey."""

    def __post_init__(self) -> None:
        self._load()

    def _load(self) -> None:
        """What the EDS says, and what is stored."""
        for key, (value, kind) in objects_of(self.eds, self.node_id).items():
            self.values[key], self.kinds[key] = value, kind
        self.values.update(self.stored)

    # --- frames -----------------------------------------------------------------------------------

    def take(self, frame: Frame, now_ns: int) -> list[tuple[Frame, int]]:
        """What this node answers to a frame, each with a delay in ns."""
        if self.dead:
            return []
        if frame.can_id == 0:
            return self._nmt(frame.data, now_ns)
        if frame.can_id == 0x600 + self.node_id and self.nmt_state != 0x04:
            return self._sdo(frame.data)
        if frame.can_id == 0x080 and self.nmt_state == 0x05:
            return self._tpdos()
        return []

    def beats(self, now_ns: int) -> list[Frame]:
        period_ns = self.values[0x1017, 0] * MS
        frames = []
        while self.next_beat_ns is not None and self.next_beat_ns <= now_ns:
            if not (self.dead or self.no_heartbeat):
                frames.append(Frame(0x700 + self.node_id, bytes((self.nmt_state,))))
            self.next_beat_ns += max(period_ns, MS)
        return frames

    def _nmt(self, data: bytes, now_ns: int) -> list[tuple[Frame, int]]:
        if data[1] not in (0, self.node_id):
            return []
        if data[0] in (0x81, 0x82):
            # NMT reset communication restores 1000h to 1FFFh only; 1001h is no setting.
            kept = {k: v for k, v in self.values.items() if k[0] >= 0x2000 or k[0] == 0x1001}
            self._load()
            self.values.update(kept if data[0] == 0x82 else {})
            self.nmt_state, self.next_beat_ns = 0x7F, None
            boots = (self.boot_delay_ns, *self.extra_boots_ns)
            return [(Frame(0x700 + self.node_id, b"\x00"), delay) for delay in boots]
        if not self.never_operational:
            self.nmt_state = {0x01: 0x05, 0x02: 0x04, 0x80: 0x7F}[data[0]]
        self.sync_count = 0
        return []

    def _sdo(self, data: bytes) -> list[tuple[Frame, int]]:
        command, index, sub = struct.unpack_from("<BHB", data)
        key = (index, sub)
        replies: list[tuple[Frame, int]] = []
        if key in self.stale_reply:
            replies.append((self.stale_reply.pop(key), 0))
        if command & 0xE0 == 0x80 or key in self.mute:
            return replies
        if command == 0x40:
            reply = self._upload(key)
        else:
            size = 4 - (command >> 2 & 3)
            reply = self._download(key, data[4 : 4 + size])
        replies.append((Frame(0x580 + self.node_id, reply), MS))
        if key in self.answers_twice:
            replies.append((Frame(0x580 + self.node_id, reply), 2 * MS))
        if key == self.reboot_on_write and command != 0x40:
            replies.append((Frame(0x700 + self.node_id, b"\x00"), 2 * MS))
        return replies

    def _upload(self, key: tuple[int, int]) -> bytes:
        if key in self.abort_read or key not in self.values:
            return self._abort(key, self.abort_read.get(key, 0x06020000))
        bits, signed, _ = self.kinds[key]
        if key == (0x1018, 4) and self.serials:
            self.values[key], *rest = self.serials
            self.serials = (*rest, self.values[key])
        raw = self.values[key].to_bytes(bits // 8, "little", signed=signed)
        command = 0x43 | (4 - len(raw)) << 2
        return struct.pack("<BHB", command, *key) + raw.ljust(4, b"\0")

    def _download(self, key: tuple[int, int], raw: bytes) -> bytes:
        code = self.abort_write.get(key) or self._objection(key, raw)
        if code:
            return self._abort(key, code)
        value = int.from_bytes(raw, "little", signed=self.kinds[key][1])
        self.written.append((*key, value))
        if key == (0x6040, 0) and self.disabled_statusword is not None:
            self.values[0x6041, 0] = self.disabled_statusword
        if key == (0x1017, 0):
            self.next_beat_ns = 0 if value else None
        if key not in self.ignore_write:
            self.values[key] = value
        return struct.pack("<BHB", 0x60, *key) + bytes(4)

    def _objection(self, key: tuple[int, int], raw: bytes) -> int:
        if key not in self.values:
            return 0x06020000
        bits, _, access = self.kinds[key]
        if "w" not in access:
            return 0x06010002
        if len(raw) * 8 != bits:
            return 0x06070010
        return self._pdo_objection(key, int.from_bytes(raw, "little"))

    def _pdo_objection(self, key: tuple[int, int], value: int) -> int:
        """CiA 301 7.5.2.35 to 7.5.2.38: order and limits of mapping."""
        index, sub = key
        communication = index & ~0x01FF in (0x1400, 0x1800) and index & 0xFF < 4
        mapping = index & ~0x01FF in (0x1600, 0x1A00) and index & 0xFF < 4
        if communication:
            valid = not self.values[index, 1] & 0x80000000
            same_id = (value ^ self.values[index, 1]) & 0x1FFFFFFF == 0
            if sub == 1 and valid and not same_id:
                return 0x06010000
            return 0x06090030 if sub == 3 and valid else 0
        if mapping:
            if not self.values[index - 0x200, 1] & 0x80000000:
                return 0x06010000
            if sub == 0:
                bits = sum(self.values[index, n] & 0xFF for n in range(1, value + 1))
                return 0x06040042 if bits > 64 else 0
            if self.values[index, 0]:
                return 0x06010000
            known = self.kinds.get((value >> 16, value >> 8 & 0xFF))
            may = known and known[0] == value & 0xFF and known[2].endswith("mapped")
            return 0 if may else 0x06040041
        return 0

    @staticmethod
    def _abort(key: tuple[int, int], code: int) -> bytes:
        return struct.pack("<BHBI", 0x80, *key, code)

    def _tpdos(self) -> list[tuple[Frame, int]]:
        self.sync_count += 1
        frames = []
        for number in range(4):
            identifier = self.values[0x1800 + number, 1]
            divider = self.values[0x1800 + number, 2]
            due = divider and self.sync_count % divider == 0
            if identifier & 0x80000000 or not due or number + 1 in self.without_tpdo:
                continue
            data = self.mapped(0x1A00 + number)
            if number + 1 in self.short_tpdo:
                data = data[:-1]
            frames.append((Frame(identifier & 0x7FF, data), (number + 1) * MS // 10))
        return frames

    def mapped(self, index: int) -> bytes:
        data = b""
        for sub in range(1, self.values[index, 0] + 1):
            entry = self.values[index, sub]
            key = (entry >> 16, entry >> 8 & 0xFF)
            bits, signed, _ = self.kinds[key]
            data += self.values[key].to_bytes(bits // 8, "little", signed=signed)
        return data


def scripted(description, **behaviour: object) -> ScriptedDrive:
    """The drive that a description describes, with its motor data set."""
    node = ScriptedDrive(description.eds, description.node_id, **behaviour)
    for base in description.torque_bases:
        node.values[base.ref.index, base.ref.sub] = base.expected_raw
    node.stored = {(0x1018, 2): description.axis.identity.product_code, **node.stored}
    node.values |= node.stored
    node.values[0x6041, 0] = 0x0240
    return node
