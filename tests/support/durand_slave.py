"""durand 0.5.0 as our drives, in lock-step: a CANopen slave that we did not write.

durand knows CiA 301 and nothing of CiA 402: the objects of the plan are added to its dictionary
from our EDS. What else it lacks or has wrong, and what is done about it:

1. No power state machine: `third_model.Model` stands behind 6040h and 6041h.
2. No 1016h, 1029h, 1003h, 1010h, 1011h: those of the EDS are plain variables, without a function.
3. No event timer and no RPDO timer (sub-index 5): plain variables.
4. A TPDO of type n > 1 comes with every SYNC after the n-th: TPDO3 (type 10) is then only frequent.
5. Reset communication restores no object: the next bring-up writes them all again.
6. A mapping is taken while the PDO is valid, and unchecked: nothing here needs a refusal.
"""

from durand import MinimalNode, Record, Variable, set_scheduler
from durand.datatypes import DatatypeEnum
from durand.network import NetworkABC
from durand.scheduler import VirtualScheduler
from memory_bus import scripted
from third_model import Model, statusword

from drives.canopen.frame import Frame
from drives.cia402.profile import DriveDescription

NEVER_NS = 1 << 62
SERIAL_NUMBER = 77
REMOTE, VOLTAGE, FOLLOWS = 0x0200, 0x0010, 0x1000
TYPES = {
    (8, False): DatatypeEnum.UNSIGNED8,
    (8, True): DatatypeEnum.INTEGER8,
    (16, False): DatatypeEnum.UNSIGNED16,
    (16, True): DatatypeEnum.INTEGER16,
    (32, False): DatatypeEnum.UNSIGNED32,
    (32, True): DatatypeEnum.INTEGER32,
}


def variable(kind: tuple[int, bool, str], value: int) -> Variable:
    bits, signed, access = kind
    return Variable(TYPES[bits, signed], "rw" if "w" in access else "ro", value)


def fill(node: MinimalNode, description: DriveDescription) -> None:
    """Everything of the EDS that durand does not bring along."""
    ours = scripted(description)
    dictionary = node.object_dictionary
    for (index, sub), kind in ours.kinds.items():
        whole = (index, 1) not in ours.kinds and sub == 0
        if index in dictionary or index in range(0x1400, 0x1C00) or index == 0x1200:
            continue
        if whole:
            dictionary[index] = variable(kind, ours.values[index, sub])
            continue
        dictionary[index] = record = Record()
        for other in range(1, 16):
            if (index, other) in ours.kinds:
                record[other] = variable(ours.kinds[index, other], ours.values[index, other])
    for number in range(4):
        for index in (0x1400, 0x1800):
            if (index + number, 5) in ours.kinds:
                dictionary[index + number][5] = Variable(DatatypeEnum.UNSIGNED16, "rw", 0)
    dictionary.write(0x1000, 0, 0x00020192)
    own = description.axis.identity
    identity = (own.vendor_id, own.product_code, own.revision, SERIAL_NUMBER)
    for sub, value in enumerate(identity, start=1):
        dictionary.write(0x1018, sub, value)


class _Wire(NetworkABC):
    """One node's end of the wire."""

    def __init__(self, world: "DurandWorld") -> None:
        self.world = world
        self.listeners: dict[int, object] = {}
        self.cut = False

    def add_subscription(self, cob_id, callback):
        self.listeners[cob_id] = callback

    def remove_subscription(self, cob_id):
        self.listeners.pop(cob_id)

    def send(self, cob_id, msg):
        if not self.cut:
            self.world.outbox.append(Frame(cob_id, bytes(msg), self.world.now_ns))

    def deliver(self, frame: Frame) -> None:
        listener = self.listeners.get(frame.can_id)
        if listener is not None and not self.cut:
            listener(frame.can_id, frame.data)


class DurandDrive:
    """One node with a power state machine, a motor that stands still, and a torque that obeys."""

    def __init__(self, world: "DurandWorld", description: DriveDescription) -> None:
        self.wire = _Wire(world)
        self.node = MinimalNode(self.wire, description.node_id)
        self.dictionary = self.node.object_dictionary
        fill(self.node, description)
        self.model = Model("switch on disabled", automatic_4=False)
        updated = self.dictionary.update_callbacks
        updated[0x6040, 0].add(self._controlword)
        updated[0x6060, 0].add(lambda mode: self.dictionary.write(0x6061, 0, mode))
        updated[0x6071, 0].add(lambda torque: self.dictionary.write(0x6077, 0, torque))
        self.show()

    def _controlword(self, word: int) -> None:
        self.model.take(word)
        self.show()

    def show(self) -> None:
        """The statusword of the model's state."""
        enabled = self.model.state == "operation enabled"
        word = statusword(self.model.state, REMOTE | VOLTAGE | FOLLOWS * enabled)
        self.dictionary.write(0x6041, 0, word)

    def fault(self, code: int) -> None:
        self.model.state = "fault"
        self.show()
        self.node.emcy.set(code, 0x01)


class DurandWorld:
    """What `gaitd_lab.WorldBus` needs of a world, with durand's nodes in it."""

    def __init__(self, descriptions: list[DriveDescription]) -> None:
        self.now_ns = 0
        self.outbox: list[Frame] = []
        self.scheduler = VirtualScheduler()
        set_scheduler(self.scheduler)
        self.drives = [DurandDrive(self, description) for description in descriptions]

    def receive(self, frame: Frame) -> None:
        for drive in self.drives:
            drive.wire.deliver(frame)

    def next_event_ns(self) -> int:
        times = self.scheduler._timestamp_dict.values()
        return NEVER_NS if not times else round(min(times) * 1e9)

    def advance_to(self, time_ns: int) -> list[Frame]:
        while (event_ns := max(self.next_event_ns(), self.now_ns)) <= time_ns:
            self._run_to(event_ns)
        self._run_to(time_ns)
        sent, self.outbox = self.outbox, []
        return sent

    def _run_to(self, time_ns: int) -> None:
        self.now_ns = time_ns
        self.scheduler.run(max(time_ns * 1e-9 - self.scheduler._time, 0.0) + 1e-10)
