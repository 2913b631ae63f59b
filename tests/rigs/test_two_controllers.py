"""The service on one emulated CAN controller, the virtual drives on another: a real driver.

QEMU's SJA1000 carries frames, and takes bit rate, restart and queue length; it makes no errors:
whatever is sent counts as acknowledged. What a driver says of error passive and bus-off is in
test_usb_adapters.py, and what each single error frame does in test_service_on_vcan.py.
"""

import pytest
from gaitd_names import Cause, Mode

from drives.canopen.bus_state import BusCondition
from drives.verification.evidence import read
from drives.verification.facts import Judgement

MISSED_MAX_RATIO = 0.05
PASSED = 22
pytestmark = [pytest.mark.rig_vcan, pytest.mark.timeout(3000)]


def test_the_leg_walks_over_two_controllers_at_1_mbit_per_s(controllers_world):
    link = controllers_world.facts["controller"]
    records = controllers_world.records("controllers")

    assert link["linkinfo"]["info_data"]["bittiming"]["bitrate"] == 1_000_000
    assert link["linkinfo"]["info_data"]["restart_ms"] == 100
    assert link["linkinfo"]["info_data"]["state"] == "ERROR-ACTIVE"
    assert link["txqlen"] == 100
    assert {record.mode for record in records} == {Mode.GAIT}
    # A guest on a loaded host may answer one SYNC after its window; the leg walks on over it.
    missed = [record.cycle for record in records if not all(one.fresh for one in record.drives)]
    assert len(missed) <= MISSED_MAX_RATIO * len(records), missed
    assert {record.bus.condition for record in records} == {BusCondition.ACTIVE.value}


def test_a_controller_that_is_not_bus_off_cannot_be_restarted(controllers_world):
    assert controllers_world.facts["restart_refused"]


def test_drives_whose_controller_is_down_are_lost_and_a_reset_finds_them_again(controllers_world):
    records = controllers_world.records("other_down")

    assert records[-1].mode == Mode.FAULT
    assert records[-1].verdict.cause in {Cause.DRIVE_SILENT, Cause.HEARTBEAT_LOST}
    # The emulation's own: a frame that no other node has heard counts as sent.
    info = controllers_world.facts["controller_alone"]["linkinfo"]["info_data"]
    assert info["state"] == "ERROR-ACTIVE"
    assert records[-1].bus.no_ack_count == 0


def test_a_drive_is_verified_through_both_controllers(controllers_world):
    found, _ = read(controllers_world.folder / "hip.zip")

    assert controllers_world.facts["verify_exit"] == 0, controllers_world.text("verify.log")
    assert not [fact for fact in found.facts if fact.judgement is Judgement.FAILED]
    assert sum(fact.judgement is Judgement.PASSED for fact in found.facts) == PASSED


def test_our_own_controller_may_be_set_down_and_up(controllers_world):
    records = controllers_world.records("own_down")

    assert records[-1].mode == Mode.FAULT
    assert records[-1].verdict.cause == Cause.BUS_DOWN
    assert controllers_world.facts["controllers_exit"] == 0
