"""A program of others stands in for one drive, beside the virtual ones of `gaitd sim --without`."""

import contextlib
import json
import socket
import struct
import threading

import canopen
import pytest
from command_line import gaitd
from drive_files import FOLDER
from processes import Service

from daemon.config.trainer import load_trainer
from gaitd_lab.virtual_machine import virtual_machine
from sim_drives.faults.script import FaultCommandError
from sim_drives.plant.truth import TruthLog

NODE = 6
VENDOR, PRODUCT, REVISION, SERIAL = 0xFB, 0x65510000, 0x01700000, 4711


VALUES = {
    (0x1000, 0): 0x00020192,
    (0x1018, 0): 4,
    (0x1018, 1): VENDOR,
    (0x1018, 2): PRODUCT,
    (0x1018, 3): REVISION,
    (0x1018, 4): SERIAL,
}


# --- two outsiders --------------------------------------------------------------------------------


class PlainNode:
    """A seat in step, written from docs/simulated_bus.md: a socket, `struct`, nothing of gaitd."""

    def __init__(self, path):
        self._end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._end.connect(path)
        self._end.send(struct.pack("<BBq", 1, 1, 0) + b"slide of another maker")
        self._now_ns = struct.unpack("<BqqB", self._end.recv(16384))[1]
        self._send(0x700 + NODE, b"\0")
        self._thread = threading.Thread(target=self._live)
        self._thread.start()

    def close(self):
        self._end.shutdown(socket.SHUT_RDWR)
        self._thread.join(60)
        self._end.close()

    def _live(self):
        with contextlib.suppress(OSError):  # that is how its end comes
            while True:
                self._end.send(struct.pack("<BqB", 3, self._now_ns + 50_000_000, 1))
                message = self._end.recv(16384)
                while message[:1] == b"\x11":  # FRAMES before the GRANT
                    for can_id, length, _, _, data in struct.iter_unpack("<IBBq8s", message[1:]):
                        self._hear(can_id, data[:length])
                    message = self._end.recv(16384)
                if not message:
                    return
                self._now_ns = struct.unpack("<Bq", message)[1]

    def _hear(self, can_id, data):
        if can_id != 0x600 + NODE:
            return
        command, index, sub = struct.unpack_from("<BHB", data)
        if command == 0x40 and (index, sub) in VALUES:
            answer = struct.pack("<BHBI", 0x43, index, sub, VALUES[index, sub])
        else:
            answer = struct.pack("<BHBI", 0x80, index, sub, 0x06020000)
        self._send(0x580 + NODE, answer)

    def _send(self, can_id, data):
        frame = struct.pack("<IBBq8s", can_id, len(data), 0, 0, data)
        self._end.send(struct.pack("<Bq", 2, self._now_ns) + frame)


class CanopenNode:
    """python-canopen's LocalNode, by the computer's clock."""

    def __init__(self, path):
        self._network = canopen.Network()
        self._network.NOTIFIER_CYCLE = 0.02
        self._network.connect(interface="gaitd", channel=path)
        node = self._network.create_node(NODE, str(FOLDER / "epos4.eds"))
        node.sdo[0x1018][2].raw = PRODUCT
        node.sdo[0x1018][4].raw = SERIAL
        node.set_data(0x1008, 0, b"EPOS4 Module 50/8 CAN")
        self._network.send_message(0x700 + NODE, b"\0")

    def close(self):
        self._network.disconnect()


@pytest.mark.parametrize(
    ("arguments", "outsider"), [(["--pace", "4"], PlainNode), (["--wall-clock"], CanopenNode)]
)
def test_a_node_of_others_answers_in_the_place_of_a_drive(tmp_path, arguments, outsider):
    service = Service(tmp_path)
    try:
        service.start("sim", "--without", "right/slide", *arguments)
        service.wait(lambda: "virtual drives right/hip on" in service.log("sim"), 60)
        with (
            service.listener() as bus,
            contextlib.closing(outsider(str(tmp_path / "bus"))),
        ):
            boot_up = bus.recv(10)
            while boot_up is not None and boot_up.arbitration_id != 0x700 + NODE:
                boot_up = bus.recv(10)
            ended = gaitd("scan", "--config", service.config, "--json")
    finally:
        service.end()

    assert boot_up is not None and bytes(boot_up.data) == b"\0"
    hip, slide = json.loads(ended.out)["stations"]
    assert (hip["node_id"], hip["drive"]) == (5, "right/hip")
    assert (slide["node_id"], slide["drive"]) == (6, "right/slide")
    assert (slide["vendor_id"], slide["product_code"], slide["serial"]) == (VENDOR, PRODUCT, SERIAL)
    assert ended.code == 0, ended.out


# --- the axis behind it ---------------------------------------------------------------------------


def test_the_axis_of_a_missing_drive_has_no_torque_and_its_faults_are_refused():
    truth = TruthLog(None)
    machine = virtual_machine(
        load_trainer(FOLDER.parent / "demo.toml"), truth={"right": truth}, without=["right/slide"]
    )

    heard = {frame.can_id for frame in machine.world.advance_to(2_000_000_000)}
    machine.record_truth(1)

    assert heard == {0x705}
    assert machine.world.drives == ("right/hip",)
    assert truth.rows[-1].slide_force_n == 0
    with pytest.raises(FaultCommandError, match=r"unknown drive 'right/slide'; known: right/hip"):
        machine.command("silent right/slide 0.5")
