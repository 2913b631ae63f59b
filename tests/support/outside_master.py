"""python-canopen as a master, on a bus with the virtual drives in real time."""

import contextlib
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from queue import Empty, Queue

import can
import canopen
from canopen.profiles.p402 import BaseNode402
from drive_bench import CONFIGS, Bench

from sim_drives.time.wall_clock import RealTime

TIMEOUT_S = 30.0
"""How long an outside master waits for an answer: a busy machine is no fault of the drives."""


def eventually(met: Callable[[], object]) -> bool:
    """Whether it comes true while we are patient; it is asked at least once."""
    end_s = time.monotonic() + TIMEOUT_S
    while not met():
        if time.monotonic() > end_s:
            return False
    return True


def eds_of(name: str) -> str:
    return str(CONFIGS / f"drives/{name}.eds")


class Station:
    """The bench's world in real time, in a thread of its own, on a virtual bus of its own."""

    def __init__(self, bench: Bench, bus: can.BusABC) -> None:
        self._world = bench.world
        self._commands: Queue[str] = Queue()
        self._over = False
        self._thread = threading.Thread(target=RealTime(bench.world, bus).run, args=(self._turn,))
        self._thread.start()

    def command(self, line: str) -> None:
        """A fault as in `sim_drives.faults.script`, done when this returns."""
        self._commands.put(line)
        self._commands.join()

    def close(self) -> None:
        self._over = True
        self._thread.join()

    def _turn(self) -> bool:
        with contextlib.suppress(Empty):
            self._world.command(self._commands.get_nowait())
            self._commands.task_done()
        return self._over


@contextlib.contextmanager
def on_a_bus(bench: Bench) -> Iterator[tuple[canopen.Network, Station]]:
    """A network of canopen's, and the virtual drives on the same bus."""
    channel = uuid.uuid4().hex
    with can.Bus(interface="virtual", channel=channel) as bus:
        network = canopen.Network()
        network.NOTIFIER_CYCLE = 0.05  # s; how long its thread takes to end
        network.connect(interface="virtual", channel=channel)
        station = Station(bench, bus)
        try:
            yield network, station
        finally:
            network.sync.stop()
            network.disconnect()
            station.close()


class PatientNode(BaseNode402):
    """canopen's CiA 402 master, with more patience than it has by itself."""

    TIMEOUT_RESET_FAULT = TIMEOUT_S
    TIMEOUT_SWITCH_OP_MODE = TIMEOUT_S
    TIMEOUT_SWITCH_STATE_FINAL = TIMEOUT_S
    TIMEOUT_SWITCH_STATE_SINGLE = TIMEOUT_S
    TIMEOUT_CHECK_TPDO = TIMEOUT_S


def added(network: canopen.Network, node: PatientNode) -> PatientNode:
    """The node on the network, its SDO client as patient as the rest."""
    network.add_node(node)
    node.sdo.RESPONSE_TIMEOUT = TIMEOUT_S
    return node


@contextlib.contextmanager
def boot_up(node: PatientNode) -> Iterator[None]:
    """Until the boot-up message of what is done within; canopen's own waiter may miss it (#560)."""
    booted = threading.Event()
    node.network.subscribe(0x700 + node.id, lambda _id, data, _time: data[0] or booted.set())
    yield
    assert booted.wait(TIMEOUT_S)


def reset(node: PatientNode, command: str) -> None:
    """A reset by NMT, until the node is there again."""
    with boot_up(node):
        node.nmt.state = command
