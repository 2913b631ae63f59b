"""What may leave a node in each NMT state (CiA 301 7.3.2.2.3, table of states and objects).

Initialising: the boot-up message alone. Pre-operational: no PDO. Stopped: NMT error control alone.
A TPDO that had been sampled before the command came must not leave after it.
"""

import pytest
from drive_bench import Bench

HEARTBEAT, SDO, PDOS = 0x705, 0x585, (0x185, 0x285, 0x385, 0x485)
NOT_OPERATIONAL = {
    "stop": 0x02,
    "enter pre-operational": 0x80,
    "reset node": 0x81,
    "reset communication": 0x82,
}
KINDS = {
    "epos4": ({}, 0x30D1_0220),
    "generic": ({"personality": "generic", "eds": "drives/generic402.eds"}, 0x6078_0010),
    "elmo": ({"personality": "elmo_gold", "eds": "drives/elmo_gold.eds"}, 0x6078_0010),
}


@pytest.fixture(params=KINDS)
def bench(request):
    changes, torque = KINDS[request.param]
    bench = Bench(hip=changes | {"tpdo_delay_min_ms": 2.0, "tpdo_delay_max_ms": 3.0})
    bench.boot()
    bench.write(0x1017, 0, 10, 2)
    bench.go_operational(torque=torque)
    bench.run_ms(20)
    bench.forget()
    return bench


def heard(bench):
    return [timed.can_id for timed in bench.trace]


@pytest.mark.parametrize("command", NOT_OPERATIONAL.values(), ids=NOT_OPERATIONAL)
def test_a_tpdo_on_its_way_does_not_leave_after_the_node_has_left_operational(bench, command):
    bench.send(0x080)
    bench.run_ms(1)

    bench.nmt(command)
    bench.run_ms(50)

    assert not set(heard(bench)) & set(PDOS)


def test_an_operational_node_answers_sync_and_sdo_and_beats(bench):
    bench.send(0x080)
    bench.run_ms(15)
    assert bench.read(0x1000) & 0xFFFF == 402

    assert {HEARTBEAT, SDO, 0x185, 0x285} <= set(heard(bench))


def test_a_stopped_node_beats_and_says_nothing_else_whatever_comes(bench):
    bench.nmt(0x02)
    bench.forget()
    for can_id, data in (
        (0x080, b""),
        (0x605, b"\x40\x00\x10\x00\x00\x00\x00\x00"),
        (0x605, b"\x2b\x17\x10\x00\x00\x00\x00\x00"),
        (0x205, bytes(7)),
        (0x205, bytes(3)),
    ):
        bench.send(can_id, data)
        bench.run_ms(20)

    assert set(heard(bench)) == {HEARTBEAT}
    assert set(bench.frames(HEARTBEAT)) == {b"\x04"}


def test_a_pre_operational_node_answers_sdo_and_no_sync(bench):
    bench.nmt(0x80)
    bench.forget()

    bench.send(0x080)
    bench.run_ms(15)
    assert bench.read(0x1000) & 0xFFFF == 402

    assert set(heard(bench)) == {HEARTBEAT, SDO}
    assert set(bench.frames(HEARTBEAT)) == {b"\x7f"}
