"""The bus of a session from outside: what left between two SYNCs, and frames made wrong."""

import struct
from collections.abc import Callable, Iterator
from typing import NamedTuple

from drives.canopen.bus import Frame
from gaitd_lab.lockstep import LockstepSession

SYNC = 0x080
NODES = (5, 6)
ENABLE_OPERATION = 0b1000
FOLLOWS = 0x1000
QUICK_STOP_WORD = 0x0002
DISABLE_VOLTAGE_WORD = 0x0000
ENABLED_WORD = 0x000F


class Rpdo1(NamedTuple):
    """What one drive was told with its first RPDO."""

    controlword: int
    mode: int
    target_counts: int


def cycles(frames: list[Frame]) -> Iterator[list[Frame]]:
    """The master's frames, cut at every SYNC; what came before the first is dropped."""
    cut: list[Frame] | None = None
    for frame in frames:
        if frame.can_id == SYNC:
            if cut is not None:
                yield cut
            cut = []
        elif cut is not None:
            cut.append(frame)
    if cut:
        yield cut


def rpdo1(frames: list[Frame], node: int) -> list[Rpdo1]:
    """All first RPDOs to a node, in order."""
    return [
        Rpdo1(*struct.unpack("<Hbi", frame.data))
        for frame in frames
        if frame.can_id == 0x200 + node
    ]


def target_torques(frames: list[Frame], node: int) -> list[int]:
    """All of 6071h to a node, per mille, in order."""
    return [struct.unpack("<h", frame.data)[0] for frame in frames if frame.can_id == 0x300 + node]


def words_by_cycle(frames: list[Frame]) -> list[dict[int, int]]:
    """For every cycle the last controlword of each node: what acts at the next SYNC."""
    found = [{node: rpdo1(one, node) for node in NODES} for one in cycles(frames)]
    return [{node: told[-1].controlword for node, told in cycle.items() if told} for cycle in found]


def change_what_drives_say(
    session: LockstepSession, change: Callable[[Frame], Frame | None]
) -> None:
    """Every frame of the drives goes through `change`; None takes it off the bus."""
    world = session.machine.world
    honest = world.advance_to

    def advance_to(time_ns: int) -> list[Frame]:
        changed = [change(frame) for frame in honest(time_ns)]
        return [frame for frame in changed if frame is not None]

    world.advance_to = advance_to


def change_what_drives_hear(session: LockstepSession, change: Callable[[Frame], Frame]) -> None:
    """Every frame of the master's goes through `change` before the drives get it."""
    world = session.machine.world
    honest = world.receive
    world.receive = lambda frame: honest(change(frame))


def without_bit_12(node: int) -> Callable[[Frame], Frame]:
    """The node's TPDO1 with `follows` taken out of its statusword."""

    def change(frame: Frame) -> Frame:
        if frame.can_id != 0x180 + node:
            return frame
        word = int.from_bytes(frame.data[:2], "little") & ~FOLLOWS
        return frame._replace(data=word.to_bytes(2, "little") + frame.data[2:])

    return change


def deaf_to_mode(node: int, mode: int) -> Callable[[Frame], Frame]:
    """The node's RPDO1 with this mode of operation, whatever the master asked for."""

    def change(frame: Frame) -> Frame:
        if frame.can_id != 0x200 + node:
            return frame
        data = frame.data[:2] + mode.to_bytes(1, "little", signed=True) + frame.data[3:]
        return frame._replace(data=data)

    return change
