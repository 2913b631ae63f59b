"""One boot for all that needs SocketCAN: tests/support/scenarios.py, and what it has left.

Numba's machine code is made on the host, for a processor without extensions ("generic"), because
compiling in the virtual machine takes minutes; the guest finds it where `numba/` lies beside its
results. The cache on the host outlives the tests.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest
from bus_recorder import Wiretap
from candump import candump_line
from sessions import new_session

from daemon.ipc.record import CycleRecord
from drives.canopen.bus import Frame

SUPPORT = Path(__file__).parents[1] / "support"
CACHE = Path.home() / ".cache" / "gaitd" / "numba-generic"
TIMEOUT_S = 2400
"""For a machine on which much else runs; two or three minutes on one that is free."""
LINE = re.compile(r"\((\d+)\.(\d{6})\) \w+ ([0-9A-F]+)#([0-9A-F]*)")
SCRIPT = """
modprobe vcan; modprobe can-raw
ip link add dev vcan0 type vcan; ip link set vcan0 up; ip link set lo up
python exchange.py > exchange.log
canbusload -e vcan0@1000000 > load < /dev/null & measuring=$!
sleep 1.5
canplayer vcan0=can0 -I session.candump
sleep 2.5
kill $measuring
export NUMBA_CPU_NAME=generic NUMBA_CACHE_DIR=$PWD/numba PYTHONPATH={support}
python {support}/rig_service.py $PWD {scenarios}
"""
ON_VCAN = ("service_on_vcan", "bench_on_vcan")
ON_CONTROLLERS = (
    "service_on_two_controllers",
    "verified_on_two_controllers",
    "service_on_usb_adapters",
)
CONTROLLERS = " -object can-bus,id=c0 -device kvaser_pci,canbus=c0 -device kvaser_pci,canbus=c0"
"""Two SJA1000 of QEMU on one bus: can0 and can1."""
EXCHANGE = """
import can
with can.Bus(interface="socketcan", channel="vcan0") as drive, can.Bus(
    interface="socketcan", channel="vcan0"
) as master:
    master.send(can.Message(arbitration_id=0x080, is_extended_id=False))
    print(drive.recv(timeout=5))
"""


@pytest.fixture
def pictures(pytestconfig):
    """Where the pictures of docs/pages_in_pictures.md are written."""
    project = Path(__file__).parents[2]
    is_for_docs = pytestconfig.option.write_pages
    return project / ("docs/pictures" if is_for_docs else "out/display/pictures")


class Witnessed(NamedTuple):
    """A frame as candump has seen it."""

    time_ns: int
    frame: Frame


class World:
    """What the small world has left in its folder."""

    def __init__(self, folder: Path, wire: Wiretap) -> None:
        self.folder = folder
        self.wire = wire
        """The lock-step session that canplayer has played."""

    @cached_property
    def facts(self) -> dict[str, Any]:
        return json.loads((self.folder / "facts.json").read_text())

    def text(self, name: str) -> str:
        return (self.folder / name).read_text()

    def records(self, name: str) -> list[CycleRecord]:
        data = (self.folder / f"{name}.records").read_bytes()
        return msgspec.msgpack.decode(data, type=list[CycleRecord])

    def frames(self, name: str) -> list[Witnessed]:
        """What candump has seen on the bus."""
        found: list[Witnessed] = []
        for line in self.text(f"{name}.candump").splitlines():
            match = LINE.fullmatch(line)
            assert match is not None, line
            seconds, micros, can_id, data = match.groups()
            time_ns = int(seconds) * 1_000_000_000 + int(micros) * 1000
            frame = Frame(int(can_id, 16), bytes.fromhex(data), is_error=len(can_id) > 3)
            found.append(Witnessed(time_ns, frame))
        return found


def compiled_for_any_processor(folder: Path) -> None:
    """Machine code for the guest, made here and put into its folder."""
    environment = {
        **os.environ,
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CACHE_DIR": str(CACHE),
        "PYTHONPATH": str(SUPPORT),
    }
    subprocess.run(
        [sys.executable, str(SUPPORT / "rig_service.py"), "warm"], env=environment, check=True
    )
    shutil.copytree(CACHE, folder / "numba")


@pytest.fixture(scope="session", name="compiled_for_any_processor")
def _compiled_for_any_processor():
    return compiled_for_any_processor


def with_controllers(rig: Any, *, emulated: bool) -> Any:
    """The rig, with two CAN controllers where it is a virtual machine, or `emulated` wants one."""

    class WithControllers(type(rig)):
        def native(self) -> bool:
            return not emulated and super().native()

        def command(self, script: Path, folder: Path) -> list[str]:
            words = super().command(script, folder)
            return [w + CONTROLLERS if w.startswith("--qemu-opts=") else w for w in words]

    return WithControllers()


def boot(rig: Any, folder: Path, scenarios: tuple[str, ...]) -> None:
    """Run scenarios; what they said, if they did not come to their end."""
    compiled_for_any_processor(folder)
    script = SCRIPT.format(support=SUPPORT, scenarios=" ".join(scenarios))
    finished = rig.run(script, folder, TIMEOUT_S)
    logs = "\n".join(f"--- {path.name}\n{path.read_text()}" for path in folder.glob("*.log"))
    assert finished.exit_code == 0, f"{finished.output}\n{logs}"


@pytest.fixture(scope="session")
def vcan_world(vcan_rig, tmp_path_factory):
    """Everything on vcan0; in a virtual machine also what is on controllers, in the same boot."""
    folder = tmp_path_factory.mktemp("vcan")
    wire = prepared(folder)
    more = () if vcan_rig.native() else ON_CONTROLLERS
    boot(with_controllers(vcan_rig, emulated=False), folder, ON_VCAN + more)
    return World(folder, wire)


@pytest.fixture(scope="session")
def controllers_world(vcan_rig, vcan_world, tmp_path_factory):
    """Everything on two controllers: always in a virtual machine."""
    if not vcan_rig.native():
        return vcan_world
    rig = with_controllers(vcan_rig, emulated=True)
    lack = rig.lacks()
    if lack:
        pytest.skip(f"emulated controllers: {lack}")
    folder = tmp_path_factory.mktemp("controllers")
    wire = prepared(folder)
    boot(rig, folder, ON_CONTROLLERS)
    return World(folder, wire)


def prepared(folder: Path) -> Wiretap:
    """What the script plays; the lock-step session that it is of."""
    session = new_session().walk()
    wire = Wiretap(session.machine.world)
    session.run(1.0)
    begun_ns = wire.lines[0].time_ns
    dump = "".join(candump_line(line.time_ns - begun_ns, line.frame) + "\n" for line in wire.lines)
    (folder / "session.candump").write_text(dump)
    (folder / "exchange.py").write_text(EXCHANGE)
    return wire
