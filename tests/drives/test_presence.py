"""Nodes that should not be on the bus: how long bring-up listens, and what is one of them."""

import pytest
from memory_bus import MS, ManualClock

from drives.bringup.objects import SdoTarget
from drives.bringup.port import NodeTraffic
from drives.bringup.presence import OtherMaster, refuse_second_answer, refuse_second_node, until
from drives.errors import BootFailure, BringUpRefused, DriveSilent

MASTER = 1


class Port:
    """A port on which time passes only while it waits, and things happen at their time."""

    def __init__(self, serials=()):
        self.clock = ManualClock()
        self.waits_ms = []
        self.foreign_sync_count = 0
        self.node = NodeTraffic()
        self.serials = list(serials)
        self.happens = {}
        """Changes to this port, by milliseconds from now."""
        self.began_ns = self.now_ns()

    def now_ns(self):
        return self.clock.now_ns()

    def wait(self, until_ns):
        self.waits_ms.append((until_ns - self.now_ns()) / MS)
        self.clock.time_ns = until_ns
        for after_ms in sorted(self.happens):
            if self.began_ns + after_ms * MS <= until_ns:
                self.happens.pop(after_ms)(self)

    def traffic(self, node_id):
        assert node_id in (MASTER, 5)
        return self.node

    def read(self, node_id, index, sub):
        assert (node_id, index, sub) == (5, 0x1018, 4)
        return self.serials.pop(0).to_bytes(4, "little")


def beats(port):
    port.node.heartbeat_count += 1


def boots(port):
    port.node.boot_up_count += 1


def syncs(port):
    port.foreign_sync_count += 1


def answers_again(port):
    port.node.sdo_repeat_count += 1


def test_a_wait_is_cut_into_slices_that_end_with_the_deadline():
    port = Port()

    assert list(until(port, port.now_ns() + 25 * MS, "waits", lambda: False)) == ["waits"] * 3
    assert port.waits_ms == [10, 10, 5]


def test_a_second_answer_may_come_twenty_milliseconds_after_either_request():
    target = SdoTarget(Port([7, 7]), "right/hip", 5)

    texts = list(refuse_second_node(target, 0, "asks"))

    assert texts == ["asks"] * 4
    assert target.port.waits_ms == [10, 10, 10, 10]


@pytest.mark.parametrize("after_ms", [20, 40])
def test_a_second_answer_that_comes_late_is_refused(after_ms):
    port = Port([7, 7])
    port.happens = {after_ms: answers_again}

    with pytest.raises(BringUpRefused) as caught:
        list(refuse_second_node(SdoTarget(port, "right/hip", 5), 0, "asks"))

    assert caught.value.failure is BootFailure.DUPLICATE_NODE
    assert caught.value.reason == "one request to node 5 was answered twice"


def test_an_answer_without_a_serial_number_is_told_as_one():
    port = Port()
    port.read = lambda _node_id, _index, _sub: b""

    with pytest.raises(BringUpRefused) as caught:
        list(refuse_second_node(SdoTarget(port, "right/hip", 5), 0, "asks"))

    assert caught.value.reason == "0 bytes instead of 4 (serial number)"


def test_two_serial_numbers_are_told_the_lower_one_first():
    with pytest.raises(BringUpRefused) as caught:
        list(refuse_second_node(SdoTarget(Port([0x2222, 0x1111]), "right/hip", 5), 0, "asks"))

    both = "00001111h and 00002222h"
    assert caught.value.reason == f"two serial numbers answer under node 5: {both}"


def test_answers_that_came_twice_before_this_bring_up_are_no_second_node():
    port = Port()
    port.node.sdo_repeat_count = int("1000")

    refuse_second_answer(SdoTarget(port, "right/hip", 5), int("1000"))


def test_a_master_that_was_heard_before_is_none_until_it_is_heard_again():
    port = Port()
    port.node.heartbeat_count, port.foreign_sync_count = int("1000"), int("500")
    master = OtherMaster(port, MASTER)
    port.foreign_sync_count = int("500")

    assert list(master.listen()) == ["listens for another master"] * 10
    assert port.waits_ms == [0, *[10] * 10]


BEATS = "another device sends heartbeats with the master's node id 1"
SYNCS = "another node sends SYNC"


@pytest.mark.parametrize(("does", "what"), [(beats, BEATS), (boots, BEATS), (syncs, SYNCS)])
@pytest.mark.parametrize("heard_before", [(), (beats,), (syncs,)])
def test_a_master_that_is_heard_is_told_at_once(does, what, heard_before):
    port = Port()
    for one in heard_before:
        one(port)
    port.happens = {20: does}

    with pytest.raises(DriveSilent) as caught:
        list(OtherMaster(port, MASTER).listen())

    assert (caught.value.drive, caught.value.failure) == ("", BootFailure.FOREIGN_MASTER)
    assert caught.value.what == what
    assert port.now_ns() == port.began_ns + 20 * MS
