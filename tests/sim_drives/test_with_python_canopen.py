"""Conformance: python-canopen, which we did not write, as the master of the drives in real time."""

import contextlib
import threading
import time
import uuid

import can
import canopen
import pytest
from drive_bench import CONFIGS, Bench

from sim_drives.realtime import RealTime, now_ns

EPOS4 = str(CONFIGS / "drives/epos4.eds")
PLAIN = {"personality": "generic", "eds": "drives/generic402.eds"}


@contextlib.contextmanager
def on_a_bus(bench):
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
            network.disconnect()
            over.set()
            thread.join()


@pytest.fixture
def network():
    with on_a_bus(Bench(slide=PLAIN, start_ns=now_ns())) as network:
        time.sleep(0.35)  # real time: boot-up and self-test
        yield network


@pytest.fixture
def hip(network):
    return network.add_node(5, EPOS4)


@pytest.fixture
def slide(network):
    return network.add_node(6, str(CONFIGS / "drives/generic402.eds"))


def test_canopen_reads_identity_and_names(hip, slide):
    assert hip.sdo["Identity object"]["Vendor-ID"].raw == 0xFB
    assert slide.sdo["Identity object"]["Serial number"].raw == 305_000_006
    assert hip.sdo["Manufacturer device name"].raw == "Virtual EPOS4"


def test_every_object_of_the_eds_that_can_be_read_is_answered_in_its_type(hip, slide):
    for node in (hip, slide):
        for described in node.object_dictionary.values():
            members = getattr(described, "subindices", {0: described})
            for sub, variable in members.items():
                if variable.readable:
                    entry = node.sdo[described.index]
                    value = (entry if len(members) == 1 and sub == 0 else entry[sub]).raw
                    assert isinstance(value, str if variable.data_type == 9 else int)


def test_every_default_of_the_eds_that_is_not_the_drives_own_is_what_is_read(slide):
    own = {0x1018, 0x6041, 0x6064, 0x6072, 0x6073, 0x6075, 0x6076, 0x60FD, 0x2100, 0x6062}
    for described in slide.object_dictionary.values():
        if described.index not in own and not hasattr(described, "subindices"):
            assert slide.sdo[described.index].raw == (
                described.default or type(described.default)()
            )


def test_canopen_sees_the_abort_codes(hip):
    with pytest.raises(canopen.SdoAbortedError) as refused:
        hip.sdo["Quick stop deceleration"].raw = 0
    assert refused.value.code == 0x06090032
    with pytest.raises(canopen.SdoAbortedError) as missing:
        hip.sdo.upload(0x5FFF, 0)
    assert missing.value.code == 0x06020000


def test_canopen_writes_and_reads_a_long_string_in_segments(slide):
    slide.sdo["Device label"].raw = "the slide of the right leg, 2 m"

    assert slide.sdo["Device label"].raw == "the slide of the right leg, 2 m"


def test_canopen_is_told_that_there_is_no_block_transfer(slide):
    with (
        pytest.raises(canopen.SdoAbortedError) as refused,
        slide.sdo["Device label"].open("wb", block_transfer=True, size=100) as stream,
    ):
        stream.write(bytes(100))
    assert refused.value.code == 0x05040001
    assert slide.sdo["Device type"].raw == 0x00020192


def test_canopen_maps_pdos_and_reads_what_a_sync_brings(hip, network):
    hip.tpdo.read()
    for number in (2, 3, 4):
        hip.tpdo[number].enabled = False
        hip.tpdo[number].save()
    hip.tpdo[1].clear()
    for name in ("Statusword", "Position actual value", "Modes of operation display"):
        hip.tpdo[1].add_variable(name)
    hip.tpdo[1].trans_type = 1
    hip.tpdo[1].enabled = True
    hip.tpdo[1].save()
    hip.nmt.state = "OPERATIONAL"

    network.sync.start(0.02)
    assert hip.tpdo[1].wait_for_reception(1.0) is not None
    network.sync.stop()

    assert hip.tpdo[1]["Statusword"].raw & 0x6F == 0x40
    assert hip.tpdo[1]["Position actual value"].raw == hip.sdo["Position actual value"].raw


def test_canopen_commands_the_drive_by_rpdo(hip, network):
    hip.rpdo.read()
    hip.nmt.state = "OPERATIONAL"
    hip.rpdo[1].trans_type = 1
    hip.rpdo[1]["Controlword"].raw = 0x06
    hip.rpdo[1].transmit()
    network.sync.transmit()
    time.sleep(0.02)

    assert hip.sdo["Statusword"].raw & 0x6F == 0x21


def test_canopen_sees_heartbeats_and_states(hip):
    hip.sdo["Producer heartbeat time"].raw = 10

    assert hip.nmt.wait_for_heartbeat(1.0) == "PRE-OPERATIONAL"
    hip.nmt.state = "STOPPED"
    time.sleep(0.03)
    assert hip.nmt.wait_for_heartbeat(1.0) == "STOPPED"


@pytest.mark.parametrize("command", ["RESET", "RESET COMMUNICATION"])
def test_canopen_sees_the_boot_up_after_a_reset(hip, command):
    waiting = threading.Thread(target=hip.nmt.wait_for_bootup, args=(2.0,))
    waiting.start()
    time.sleep(0.05)
    hip.nmt.state = command
    waiting.join()

    assert hip.nmt.state == "PRE-OPERATIONAL"


def test_canopen_decodes_the_emergency_of_a_lost_master(hip, network):
    hip.sdo["Consumer heartbeat time"][1].raw = 1 << 16 | 50
    network.send_message(0x701, b"\x05")

    emergency = hip.emcy.wait(0x8130, 1.0)

    assert emergency is not None
    assert emergency.register == 0x10
