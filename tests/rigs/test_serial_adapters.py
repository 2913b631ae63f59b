"""The service behind a CAN driver that reports errors: two serial adapters and a wire between them.

QEMU's controllers make no errors (test_two_controllers.py). The adapters of
tests/support/serial_adapters.py do; Debian's `slcan` drives them, and from there on everything is
the kernel's own: the states of the interface, its error frames, the carrier that is lost with
bus-off. The adapters know no restart, as most of their kind: down and up again is theirs.
"""

import pytest
from serial_adapters import State, pair

from daemon.record import Cause, Mode
from drives.bus_state import BusCondition

OURS = {0x000, 0x080, 0x701, *(base + node for base in (0x200, 0x300, 0x600) for node in (5, 6))}
on_the_rig = [pytest.mark.rig_vcan, pytest.mark.timeout(3000)]


class Host:
    """What an adapter has told."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def __call__(self, line: str) -> None:
        self.told.append(line)


@pytest.fixture
def wire():
    hosts = Host(), Host()
    adapters = pair(hosts)
    for adapter in adapters:
        for line in ("C", "S8", "O"):
            adapter.take(line)
    return adapters, hosts


def test_a_frame_that_is_heard_arrives_and_counts_one_error_down(wire):
    (one, _), (_, host) = wire
    one.errors = 5

    one.take("t0803112233")

    assert host.told == ["t0803112233"]
    assert one.errors == 4


@pytest.mark.parametrize("silence", ["C", "S4"])
def test_a_lonely_adapter_becomes_error_passive_and_goes_no_farther(wire, silence):
    (one, other), (host, _) = wire
    other.take(silence)

    for _ in range(5):
        one.take("t0800")

    assert host.told == ["sw000096", "sp000128"]
    assert (one.state, one.errors) == (State.PASSIVE, 128)


def test_what_waited_goes_out_once_somebody_listens_and_errors_fade_frame_by_frame(wire):
    (one, other), (host, heard) = wire
    other.take("C")
    one.take("t0800")
    other.take("O")

    for _ in range(40):
        one.take("t0810")

    assert heard.told == ["t0800"] + 40 * ["t0810"]
    assert host.told[-2:] == ["sw000127", "sa000095"]


def test_a_broken_transceiver_is_bus_off_until_it_is_closed_and_opened(wire):
    (one, _), (host, heard) = wire
    one.broken = True
    one.take("t0800")
    one.broken = False
    one.take("t0800")

    assert host.told == ["sw000096", "sp000128", "sb000255"]
    assert heard.told == []

    for line in ("C", "O", "t0800"):
        one.take(line)

    assert heard.told == ["t0800"]
    assert one.state is State.ACTIVE


def rig_test(test):
    for mark in on_the_rig:
        test = mark(test)
    return test


@rig_test
def test_the_drives_are_found_over_two_serial_adapters_at_1_mbit_per_s(controllers_world):
    info = controllers_world.facts["serial"]["linkinfo"]["info_data"]

    assert info["state"] == "ERROR-ACTIVE"
    assert info["bittiming_bitrate"] == 1_000_000


@rig_test
def test_alone_on_the_wire_our_controller_is_error_passive_and_says_so(controllers_world):
    info = controllers_world.facts["serial_alone"]["linkinfo"]["info_data"]
    records = controllers_world.records("serial_alone")
    events = [event for record in records for event in record.events]

    assert info["state"] == "ERROR-PASSIVE"
    assert any("error passive" in one or "not acknowledged" in one for one in events)
    assert records[-1].bus.condition == BusCondition.PASSIVE.value
    assert records[-1].bus.bus_off_count == 0


@rig_test
def test_heard_again_the_controller_becomes_error_active_frame_by_frame(controllers_world):
    info = controllers_world.facts["serial_heard_again"]["linkinfo"]["info_data"]
    records = controllers_world.records("serial_heard_again")

    assert info["state"] == "ERROR-ACTIVE"
    assert records[-1].bus.condition == BusCondition.ACTIVE.value
    assert any("without errors again" in event for one in records for event in one.events)


@rig_test
def test_a_transceiver_that_breaks_is_bus_off_and_nothing_of_ours_gets_out(controllers_world):
    link = controllers_world.facts["serial_off"]
    last = controllers_world.records("serial_off")[-1]

    assert link["linkinfo"]["info_data"]["state"] == "BUS-OFF"
    assert "NO-CARRIER" in link["flags"]
    assert last.verdict.cause == Cause.BUS_OFF
    assert last.mode in {Mode.OFF, Mode.FAULT}
    assert (last.bus.condition, last.bus.bus_off_count) == (BusCondition.OFF.value, 1)
    assert not [one for one in controllers_world.frames("serial_off") if one.frame.can_id in OURS]


@rig_test
def test_bus_off_lasts_until_the_interface_is_set_down_and_up(controllers_world):
    facts = controllers_world.facts

    assert facts["serial_mended"]["linkinfo"]["info_data"]["state"] == "BUS-OFF"
    assert facts["serial_up_again"]["linkinfo"]["info_data"]["state"] == "ERROR-ACTIVE"
    assert facts["condition_up_again"] == BusCondition.ACTIVE.value
    assert facts["serial_exit"] == 0
