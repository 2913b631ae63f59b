"""The whole service in lock-step, its drives being durand's nodes: no frame of theirs is ours.

What durand lacks is listed in `durand_slave.py`, with what stands in for it.
"""

import struct
from types import SimpleNamespace

import pytest
from durand.scheduler import get_scheduler, set_scheduler
from durand_slave import DurandWorld
from gaitd_names import Cause, Mode, Outcome, RequestKind
from sessions import generic_drives

from daemon.preflight.load import load
from drives.cia402.units import axis_scaling, expected_base, position_to_counts
from drives.errors import BringUpRefused
from drives.signals import PowerState
from gaitd_lab.lockstep import LockstepSession

MID_POSE = (0.244, 0.5905)
"""rad, m: where the springs carry the leg, as plant.toml begins."""
INPUTS = 0x0003_0000
"""60FDh: hand switch closed, STO released."""


class Service(LockstepSession):
    def __init__(self, folder):
        settings = load(generic_drives(folder) / "demo.toml")
        self.world = DurandWorld(list(settings.drives))
        self.hip, self.slide = self.world.drives
        for drive, description, place in zip(
            self.world.drives, settings.drives, MID_POSE, strict=True
        ):
            scaling = axis_scaling(description, expected_base(description))
            drive.dictionary.write(0x6064, 0, position_to_counts(place, scaling))
            drive.dictionary.write(0x60FD, 0, INPUTS)
        super().__init__(settings, SimpleNamespace(world=self.world))

    def stopped(self):
        self.run_until(lambda record: not record.mode.active, within_s=2)
        self.run(0.5)
        return self.record


@pytest.fixture
def service(tmp_path):
    before = get_scheduler()
    yield Service(tmp_path)
    set_scheduler(before)


def test_it_is_brought_up_with_every_limit_in_durand_s_dictionary(service):
    service.until_ready()

    assert [drive.node.nmt.state for drive in service.world.drives] == [5, 5]
    for drive in service.world.drives:
        read = drive.dictionary.read
        assert read(0x6007, 0) in (1, 2, 3)
        assert read(0x1016, 1) == 1 << 16 | 100
        assert 0 < read(0x6072, 0) < 3000
        assert read(0x607D, 1) < read(0x6064, 0) < read(0x607D, 2)
        assert drive.model.state == "switch on disabled"
        assert drive.model.numbers == []


def test_it_is_enabled_arrow_by_arrow_and_holds(service):
    service.enable()
    service.run(1.0)

    record = service.record
    assert record.mode == Mode.HOLD, record.verdict
    for drive in service.world.drives:
        assert drive.model.numbers == [2, 3, 4]
    assert [axis.fresh for axis in record.drives] == [True, True]
    assert [axis.position for axis in record.drives] == pytest.approx(MID_POSE, abs=2e-4)
    for axis, drive in zip(record.drives, service.world.drives, strict=True):
        assert axis.statusword == drive.dictionary.read(0x6041, 0)
        assert axis.mode_display == drive.dictionary.read(0x6060, 0)
        assert axis.protocol_error_count == 0


def test_the_torque_that_is_sent_is_the_one_that_durand_applies_at_the_next_sync(service):
    service.enable()
    for can_id, drive in ((0x305, service.hip), (0x306, service.slide)):
        for _ in range(5):
            sent = [f for f in service.bus.sent if f.can_id == can_id][-1]
            service.run(0.01)

            (torque,) = struct.unpack("<h", sent.data)
            assert drive.dictionary.read(0x6071, 0) == torque


def test_an_emcy_of_durand_s_stops_both_drives_by_the_arrow_of_quick_stop(service):
    service.enable()

    service.hip.node.emcy.set(0x4210, 0x09)
    record = service.stopped()

    assert record.mode == Mode.FAULT
    assert (record.verdict.cause, record.verdict.drive) == (Cause.EMERGENCY, "right/hip")
    assert record.drives[0].emergency_code == 0x4210
    for drive in service.world.drives:
        assert drive.model.numbers[3:] == [11]


def test_a_heartbeat_that_ceases_stops_the_machine_though_samples_still_come(service):
    service.enable()

    service.slide.dictionary.write(0x1017, 0, 0)
    record = service.stopped()

    assert (record.verdict.cause, record.verdict.drive) == (Cause.HEARTBEAT_LOST, "right/slide")
    assert service.hip.model.state == "quick stop active"


def test_a_node_that_is_cut_off_stops_the_other_one(service):
    service.enable()

    service.slide.wire.cut = True
    record = service.stopped()

    assert (record.verdict.cause, record.verdict.drive) == (Cause.DRIVE_SILENT, "right/slide")
    assert service.hip.model.state == "quick stop active"


def test_a_node_that_reboots_is_not_started_again_by_itself(service):
    service.enable()

    service.hip.node.nmt.reset()
    record = service.stopped()

    assert record.mode == Mode.FAULT
    assert record.verdict.drive == "right/hip"
    assert service.hip.node.nmt.state != 5
    assert service.slide.model.state == "quick stop active"


def test_an_open_hand_switch_in_60fdh_stops_both(service):
    service.enable()

    service.hip.dictionary.write(0x60FD, 0, INPUTS & ~0x0001_0000)
    record = service.stopped()

    assert record.verdict.cause == Cause.HAND_SWITCH_OPEN
    assert [drive.model.state for drive in service.world.drives] == ["quick stop active"] * 2


def test_another_identity_ends_the_service_by_name(service):
    service.hip.dictionary.write(0x1018, 2, 0x00040202)

    with pytest.raises(BringUpRefused) as refused:
        service.run(5)

    assert (refused.value.drive, refused.value.place) == ("right/hip", "1018h:02")
    assert [drive.node.nmt.state for drive in service.world.drives] == [127, 127]


def test_a_fault_is_reset_by_one_edge_on_request(service):
    service.enable()
    service.hip.fault(0x3210)
    assert service.stopped().drives[0].power_state == PowerState.FAULT

    answer = service.request(RequestKind.RESET)
    service.run(0.5)

    assert answer.outcome == Outcome.DONE, answer.refusal
    assert service.hip.model.numbers[3:] == [15]
    assert service.hip.model.state == "switch on disabled"
    assert service.record.mode == Mode.READY


def test_at_the_end_both_are_without_power_and_let_go(service):
    service.enable()

    service.shut_down()

    assert [drive.model.state for drive in service.world.drives] == ["switch on disabled"] * 2
    assert [drive.node.nmt.state for drive in service.world.drives] == [127, 127]
