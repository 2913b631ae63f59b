"""A rogue master: raw frames by hand, with drives that the service has brought up and enabled.

`Rogue` takes the bus over in the middle of a session whose loop is not turned any more. Nothing of
ours limits what it sends; what stops the joints then are the limits that bring-up left in the
drives. Frames are the mapping that the design fixes: RPDO1 = 6040h, 6060h, 607Ah; RPDO2 = 6071h;
TPDO1 = 6041h, 6064h, 6061h; everything at SYNC.
"""

import struct
from dataclasses import dataclass, field

from drives.canopen.frame import Frame
from gaitd_lab.lockstep import LockstepSession
from sim_drives.plant.truth import Truth

MS = 1_000_000
CYCLE_MS = 10
NODES = (5, 6)
"""Hip and slide of the right leg."""
ENABLE = 0x000F
CSP, CST = 8, 10

OPERATION_ENABLED, QUICK_STOP_ACTIVE, FAULT_REACTION, FAULT = 0x27, 0x07, 0x0F, 0x08
_STATE_MASK = 0x6F


@dataclass
class Command:
    """What one drive is told, in its own units."""

    mode: int = CST
    position: int = 0
    torque: int = 0
    controlword: int = ENABLE


@dataclass
class Rogue:
    """The bus from the master's side; time passes in whole milliseconds."""

    session: LockstepSession
    commands: dict[int, Command] = field(init=False)
    heard: list[Frame] = field(default_factory=list)
    path: list[Truth] = field(default_factory=list)
    """The plant at each millisecond."""
    shown: list[tuple[int, int]] = field(default_factory=list)
    """State of hip and slide at each millisecond, as 6041h holds it."""
    heartbeat: bool = True
    sends_commands: bool = True
    _cycle: int = 0

    def __post_init__(self) -> None:
        self.world = self.session.machine.world
        self.trainer = self.session.machine.trainers["right"]
        self.commands = {node: Command(position=self.object(node, 0x6064)) for node in NODES}

    # --- looking in -------------------------------------------------------------------------

    def object(self, node: int, index: int, sub: int = 0) -> int:
        name = "right/hip" if node == NODES[0] else "right/slide"
        return self.world.node(name).dictionary.value(index, sub)

    def states(self) -> tuple[int, int]:
        hip, slide = (self.object(node, 0x6041) & _STATE_MASK for node in NODES)
        return tuple(0x08 if state == 0x48 else state for state in (hip, slide))  # type: ignore[return-value]

    def emergencies(self, node: int) -> list[int]:
        return [
            int.from_bytes(frame.data[:2], "little")
            for frame in self.heard
            if frame.can_id == 0x080 + node and frame.data[:2] != b"\0\0"
        ]

    # --- on the bus -------------------------------------------------------------------------

    def cycle(self) -> None:
        """SYNC, our heartbeat every second time, then all RPDOs; and 10 ms pass."""
        self._send(0x080, b"")
        if self.heartbeat and self._cycle % 2 == 0:
            self._send(0x701, b"\x05")
        self._cycle += 1
        if self.sends_commands:
            for node, said in self.commands.items():
                self._send(
                    0x200 + node, struct.pack("<Hbi", said.controlword, said.mode, said.position)
                )
                self._send(0x300 + node, struct.pack("<h", said.torque))
        self.silence(CYCLE_MS)

    def cycles(self, count: int) -> None:
        for _ in range(count):
            self.cycle()

    def die(self, duration_ms: int) -> list[Truth]:
        """The worst moment: SYNC and heartbeat leave, and then nothing. What the leg does."""
        self._send(0x080, b"")
        self._send(0x701, b"\x05")
        begun = self.trainer.truth()
        before = len(self.path)
        self.silence(duration_ms)
        return [begun, *self.path[before:]]

    def silence(self, duration_ms: int) -> None:
        """The master sends nothing; the drives and the leg go on."""
        for _ in range(duration_ms):
            self.heard += self.world.advance_to(self.world.now_ns + MS)
            self.path.append(self.trainer.truth())
            self.shown.append(self.states())

    def _send(self, can_id: int, data: bytes) -> None:
        self.world.receive(Frame(can_id, data))
