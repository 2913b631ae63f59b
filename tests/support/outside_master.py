"""python-canopen as a master, on a bus with the virtual drives in real time."""

import contextlib
import threading
import uuid
from collections.abc import Iterator

import can
import canopen
from canopen.profiles.p402 import BaseNode402
from drive_bench import CONFIGS, Bench

from sim_drives.realtime import RealTime

EPOS4 = str(CONFIGS / "drives/epos4.eds")
GENERIC = str(CONFIGS / "drives/generic402.eds")
PATIENCE_S = 10.0
"""How long an outside master waits for an answer: a busy machine is no fault of the drives."""


@contextlib.contextmanager
def on_a_bus(bench: Bench) -> Iterator[canopen.Network]:
    """The bench's world in real time on a virtual bus of its own; a network of canopen's on it."""
    channel, over = uuid.uuid4().hex, threading.Event()
    with can.Bus(interface="virtual", channel=channel) as station:
        real_time = RealTime(bench.world, station)
        thread = threading.Thread(target=real_time.run, args=(over.is_set,))
        network = canopen.Network()
        network.NOTIFIER_CYCLE = 0.05  # s; how long its thread takes to end
        network.connect(interface="virtual", channel=channel)
        thread.start()
        try:
            yield network
        finally:
            network.sync.stop()
            network.disconnect()
            over.set()
            thread.join()


class PatientNode(BaseNode402):
    """canopen's CiA 402 master, with more patience than it has by itself."""

    TIMEOUT_RESET_FAULT = PATIENCE_S
    TIMEOUT_SWITCH_OP_MODE = PATIENCE_S
    TIMEOUT_SWITCH_STATE_FINAL = PATIENCE_S
    TIMEOUT_SWITCH_STATE_SINGLE = PATIENCE_S
    TIMEOUT_CHECK_TPDO = PATIENCE_S


def added(network: canopen.Network, node: PatientNode) -> PatientNode:
    """The node on the network, its SDO client as patient as the rest."""
    network.add_node(node)
    node.sdo.RESPONSE_TIMEOUT = PATIENCE_S
    return node
