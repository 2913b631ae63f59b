"""A master of the drives according to python-canopen's documentation: the peer of `gaitd core`.

    python -m gaitd_lab.peers.python_canopen_peer --channel SOCKET --eds epos4.eds [--fifo]

It holds both axes at their initial position by a spring and a damper, as `gaitd core` does in mode
hold, and reacts to an emergency of one drive with a quick stop of both. It has no observer, no
limits and no records. It follows the documentation (canopen.readthedocs.io, pages "Network and
nodes", "PDO", "SYNC", "EMCY", "Device profiles"):

- `Network.connect`, `BaseNode402`, PDOs mapped by the names of the EDS, `pdo.save()`;
- `network.sync.start(0.01)`, and a main loop around `wait_for_reception`, `rpdo[..].raw = ...` and
  `transmit()`;
- `setup_402_state_machine`, `op_mode`, `state = "OPERATION ENABLED"`;
- `node.emcy.add_callback`, which runs in the thread that receives, and there sets controlwords.

It also includes what a user must find out in practice: the RPDO of the controlword is of type 255,
or the setter sends nothing (2.4.1); `state = ...` is not set in a callback, because it waits for a
TPDO that only the same thread could receive; a TPDO that has come already is not waited for.

Its bus is the socket of `gaitd sim --wall-clock` by python-can's interface `gaitd`. Periodic
messages come from python-can's own thread, as on every adapter but SocketCAN (where the kernel's
broadcast manager would send SYNC, on its time and not on the loop's).

SIGUSR1 recovers from a quick stop and enables again; SIGTERM ends. `--fifo` sets SCHED_FIFO for all
its threads at the core's priority.
"""

import argparse
import os
import signal
import sys
import threading
import time
from pathlib import Path

import can
import canopen
from canopen.emcy import EmcyError
from canopen.profiles.p402 import BaseNode402

PERIOD_S = 0.01
CORE_PRIORITY = 60
QUICK_STOP = 0x0002
TIMEOUT_S = 10.0
STATE = "SWITCH ON DISABLED"


class Drive(BaseNode402):
    """A drive with longer timeouts, since other load on this computer may delay its replies."""

    TIMEOUT_SWITCH_OP_MODE = TIMEOUT_S
    TIMEOUT_SWITCH_STATE_FINAL = TIMEOUT_S
    TIMEOUT_SWITCH_STATE_SINGLE = TIMEOUT_S
    TIMEOUT_CHECK_TPDO = 1.0


class Axis:
    """One drive, and the spring and damper that hold it, in the drive's own counts."""

    def __init__(self, node: Drive, stiffness: float, damping: float) -> None:
        """Set the gains, per mille of rated torque: for each count, for each count in a cycle."""
        self.node = node
        self._stiffness, self._damping = stiffness, damping
        self._held: int | None = None
        self._before = 0

    def map_pdos(self) -> None:
        """Map the TPDOs and the torque to SYNC; controlword and mode act at once."""
        node = self.node
        node.nmt.state = "PRE-OPERATIONAL"
        node.pdo.read()
        for pdo in (*node.tpdo.values(), *node.rpdo.values()):
            pdo.enabled = False
            pdo.save()
        for pdo, kind, names in (
            (
                node.tpdo[1],
                1,
                ("Statusword", "Position actual value", "Modes of operation display"),
            ),
            (node.tpdo[2], 1, ("Digital inputs",)),
            (node.rpdo[1], 255, ("Controlword", "Modes of operation")),
            (node.rpdo[2], 1, ("Target torque",)),
        ):
            pdo.clear()
            for name in names:
                pdo.add_variable(name)
            pdo.trans_type = kind
            pdo.enabled = True
            pdo.save()

    def enable(self) -> None:
        """Enable the drive from any state, with torque 0 first."""
        node = self.node
        self._held = None
        node.rpdo[2]["Target torque"].raw = 0
        node.rpdo[2].transmit()
        node.check_statusword()
        if node.state == "FAULT":
            node.controlword = 0x0000
            node.controlword = 0x0080
            node.check_statusword()
        if node.state != STATE:
            node.controlword = 0x0000
            node.check_statusword()
        node.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
        node.state = "OPERATION ENABLED"

    def hold(self) -> None:
        """Run one cycle: read the position, send the torque."""
        position = self.node.tpdo[1]["Position actual value"].raw
        if self._held is None:
            self._held = self._before = position
        speed, self._before = position - self._before, position
        torque = self._stiffness * (self._held - position) - self._damping * speed
        self.node.rpdo[2]["Target torque"].raw = max(-1000, min(1000, round(torque)))
        self.node.rpdo[2].transmit()


class Peer:
    """Master of two drives in one loop."""

    def __init__(
        self, channel: str, eds: Path, recover: threading.Event, over: threading.Event
    ) -> None:
        """Connect to the bus and add both drives."""
        self.recover, self.over = recover, over
        self.network = canopen.Network(can.Bus(interface="gaitd", channel=channel))
        self.network.connect()
        gains = ((5, 0.66, 4.4), (6, 1.2, 7.5))  # 300 N·m/rad and 20, 4000 N/m and 250
        self.axes = [Axis(self._add(number, eds), *rest) for number, *rest in gains]
        self.stopped = threading.Event()

    def _add(self, number: int, eds: Path) -> Drive:
        node = Drive(number, str(eds))
        self.network.add_node(node)
        # Both are documented settings of python-canopen: a request without a reply is repeated.
        node.sdo.RESPONSE_TIMEOUT = 0.5
        node.sdo.MAX_RETRIES = 20
        node.emcy.add_callback(self.on_emergency)
        return node

    def on_emergency(self, emergency: EmcyError) -> None:
        """Stop all drives, in the receiving thread."""
        if emergency.code & 0xFF00:
            for axis in self.axes:
                axis.node.controlword = QUICK_STOP
            self.stopped.set()

    def start(self) -> None:
        """Bring up both drives and enable them."""
        for axis in self.axes:
            axis.map_pdos()
        for axis in self.axes:
            axis.node.nmt.state = "OPERATIONAL"
        self.network.sync.start(PERIOD_S)
        for axis in self.axes:
            axis.node.setup_402_state_machine(read_pdos=False)
        self.enable()

    def enable(self) -> None:
        """Enable both drives, one after the other."""
        self.stopped.clear()
        for axis in self.axes:
            axis.enable()
        self.recover.clear()
        print("holding", flush=True)

    def run(self) -> None:
        """Run until SIGTERM: each cycle waits for both drives, then commands both."""
        seen = [0.0 for _ in self.axes]
        while not self.over.is_set():
            if self.recover.is_set():
                self.enable()
            for index, axis in enumerate(self.axes):
                pdo = axis.node.tpdo[1]
                if (pdo.timestamp or 0.0) <= seen[index]:
                    pdo.wait_for_reception(timeout=PERIOD_S)
                seen[index] = pdo.timestamp or 0.0
            if not self.stopped.is_set():
                for axis in self.axes:
                    axis.hold()

    def end(self) -> None:
        """Switch the drives off, and leave the bus."""
        for axis in self.axes:
            axis.node.controlword = 0x0000
        time.sleep(5 * PERIOD_S)
        self.network.sync.stop()
        self.network.disconnect()


def main() -> None:
    """Parse the arguments, connect, and hold until SIGTERM."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--channel", required=True)
    parser.add_argument("--eds", type=Path, required=True)
    parser.add_argument("--fifo", action="store_true")
    asked = parser.parse_args()
    if asked.fifo:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(CORE_PRIORITY))
    over, recover = threading.Event(), threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: over.set())
    signal.signal(signal.SIGUSR1, lambda *_: recover.set())
    peer = Peer(asked.channel, asked.eds, recover, over)
    peer.start()
    peer.run()
    peer.end()


if __name__ == "__main__":
    sys.exit(main())
