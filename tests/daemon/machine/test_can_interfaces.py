"""What `gaitd doctor` makes of CAN interfaces; the text is that of iproute2 6.1."""

import json

from daemon.system.machine.can_interfaces import can_interfaces
from daemon.system.machine.finding import Grade


def can(**changes):
    link = {
        "ifname": "can0",
        "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
        "txqlen": 128,
        "linkinfo": {
            "info_kind": "can",
            "info_data": {
                "state": "ERROR-ACTIVE",
                "berr_counter": {"tx": 0, "rx": 0},
                "restart_ms": 100,
                "bittiming": {"bitrate": 1000000, "sample_point": "0.750"},
            },
        },
    }
    info = link["linkinfo"]["info_data"]
    for name, value in changes.items():
        place = link if name in link else info
        place[name] = value
    return link


VCAN = {
    "ifname": "vcan0",
    "flags": ["NOARP", "UP", "LOWER_UP"],
    "txqlen": 1000,
    "linkinfo": {"info_kind": "vcan"},
}


def looked_at(*links):
    return can_interfaces(json.dumps(list(links)))


def test_a_controller_with_everything_lacks_nothing():
    finding = looked_at(can(), {}, VCAN)

    assert finding.grade is Grade.GOOD
    assert finding.found == (
        "can0 up, 1000000 bit/s, restart after 100 ms, ERROR-ACTIVE, queue of 128; "
        "vcan0 up, queue of 1000"
    )


def test_one_that_is_down_without_a_bit_rate_gets_the_whole_command():
    finding = looked_at(can(flags=["NOARP", "ECHO"], bittiming={}, state="STOPPED", restart_ms=0))

    assert finding.grade is Grade.LIMITED
    assert "no bit rate" in finding.found
    assert finding.remedy == (
        "ip link set can0 type can bitrate 1000000 restart-ms 100; ip link set can0 up"
    )


def test_one_without_a_restart_keeps_its_bit_rate_and_goes_down_first():
    finding = looked_at(can(restart_ms=0, bittiming={"bitrate": 500000}))

    assert finding.remedy == (
        "ip link set can0 down; ip link set can0 type can bitrate 500000 restart-ms 100; "
        "ip link set can0 up"
    )


def test_a_short_queue_gets_its_command():
    assert looked_at(can(txqlen=10)).remedy == "ip link set can0 txqueuelen 128"


def test_one_that_is_bus_off_is_pointed_out():
    finding = looked_at(can(state="BUS-OFF"))

    assert finding.grade is Grade.LIMITED
    assert finding.remedy.startswith("can0 is BUS-OFF: cable, termination")


def test_a_virtual_one_needs_no_bit_rate():
    assert looked_at({**VCAN, "flags": []}).remedy == "ip link set vcan0 up"


def test_none_at_all_is_told_with_how_to_have_one():
    assert looked_at().grade is Grade.MISSING
    assert can_interfaces("").grade is Grade.MISSING
