"""Detection of nodes that should not be on the bus. Part of bring-up.

Two nodes under one number answer every SDO request twice, each with its own serial number; on a
real wire both also collide, which the controller counts as errors. Another master sends SYNC, or a
heartbeat under this master's number. A single answer shows none of this, so this file also receives
the frames after it.
"""

from collections.abc import Callable, Generator
from typing import Final

from drives.bringup.objects import SdoTarget, examine
from drives.bringup.port import DrivePort
from drives.bringup.steps import SERIAL_NUMBER, Step, StepKind
from drives.errors import BootFailure, BringUpRefused, DriveSilent

LISTEN_NS: Final = 100_000_000
"""Time for ten SYNCs of another master, and five of its heartbeats."""
SLICE_NS: Final = 10_000_000
"""Longest wait between two yields."""
SECOND_ANSWER_NS: Final = 20_000_000
"""Wait after an answer for another one to the same request."""

_SERIAL_NUMBER: Final = Step(StepKind.ASK, "serial number", *SERIAL_NUMBER, is_hex=True)

Texts = Generator[str, None, None]
"""Yields after each bounded piece of work with a description of it."""


def until(
    port: DrivePort, deadline_ns: int, text: str, met: Callable[[], bool]
) -> Generator[str, None, bool]:
    """Receive in slices until the condition is met (True) or the deadline is over (False)."""
    while not met():
        now_ns = port.now_ns()
        if now_ns >= deadline_ns:
            return False
        port.wait(min(deadline_ns, now_ns + SLICE_NS))
        yield text
    return True


def refuse_second_node(target: SdoTarget, sdo_repeat_count: int, text: str) -> Texts:
    """Read a node's identity twice, and wait for a second answer to either request.

    Args:
        target: the node.
        sdo_repeat_count: its repeated SDO replies when bring-up began.
        text: progress text to yield meanwhile.

    Raises:
        BringUpRefused: two nodes answer under this number.
        DriveSilent: none does.
    """
    port, serials = target.port, set[int]()
    for _ in range(2):
        serials.add(examine(_SERIAL_NUMBER, target))
        yield from until(port, port.now_ns() + SECOND_ANSWER_NS, text, lambda: False)
    refuse_second_answer(target, sdo_repeat_count)
    if len(serials) > 1:
        both = " and ".join(map(_SERIAL_NUMBER.value_text, sorted(serials)))
        what = f"two serial numbers answer under node {target.node_id}: {both}"
        raise BringUpRefused(target.drive, BootFailure.DUPLICATE_NODE, what)


def refuse_second_answer(target: SdoTarget, sdo_repeat_count: int) -> None:
    """Refuse the node if any request of this bring-up was answered twice.

    Raises:
        BringUpRefused: a request was answered twice.
    """
    if target.port.traffic(target.node_id).sdo_repeat_count > sdo_repeat_count:
        what = f"one request to node {target.node_id} was answered twice"
        raise BringUpRefused(target.drive, BootFailure.DUPLICATE_NODE, what)


class OtherMaster:
    """Detects another master on this bus, from its creation on."""

    def __init__(self, port: DrivePort, node_id: int) -> None:
        self._port = port
        self._node_id = node_id
        port.wait(port.now_ns())  # frames queued now were sent before
        self._before = self._counts()

    def listen(self) -> Texts:
        """Listen to the bus before anything is sent: the first frame resets its drives.

        Raises:
            DriveSilent: as `check`.
        """
        deadline_ns = self._port.now_ns() + LISTEN_NS
        for text in until(self._port, deadline_ns, "listens for another master", lambda: False):
            self.check()
            yield text

    def check(self) -> None:
        """Raise if another master was detected.

        Raises:
            DriveSilent: there is another master; it names no drive, and the master may go away.
        """
        before, now = self._before, self._counts()
        if now[0] > before[0]:
            what = f"another device sends heartbeats with the master's node id {self._node_id}"
            raise DriveSilent("", BootFailure.FOREIGN_MASTER, what)
        if now[1] > before[1]:
            raise DriveSilent("", BootFailure.FOREIGN_MASTER, "another node sends SYNC")

    def _counts(self) -> tuple[int, int]:
        ours = self._port.traffic(self._node_id)
        return ours.heartbeat_count + ours.boot_up_count, self._port.foreign_sync_count
