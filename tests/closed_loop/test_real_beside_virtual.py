"""One drive of a bench and one virtual drive on one bus, under the whole service, in lock-step.

The drive of the bench is durand's CANopen with a motor of its own (`bench_motor.py`).
"""

from types import SimpleNamespace

import numpy as np
import pytest
from bench_motor import BenchWorld, OneBus, bench
from durand.scheduler import get_scheduler, set_scheduler
from gaitd_names import Cause, Mode, Outcome, RefusalCode, RequestKind
from sessions import briefly_announced, single_axis_run

from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal
from daemon.preflight.acceptance import accepted
from drives.signals import PowerState
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.simulation import missing_drives
from gaitd_lab.virtual_machine import virtual_machine
from sim_drives.plant.truth import TruthLog

AXES = ("right/hip", "right/slide")
OF_THE_SLIDE = {base + 6 for base in (0x080, 0x180, 0x280, 0x380, 0x580, 0x700)}


class Bench(LockstepSession):
    def __init__(self, folder):
        settings = briefly_announced(accepted(bench(folder, kind="epos4")))
        self.motor = BenchWorld(settings.drives[0])
        log = TruthLog(None)
        machine = virtual_machine(
            settings.file, truth={"right": log}, without=missing_drives(settings.file)
        )
        self.wire = OneBus(self.motor, machine.world)
        super().__init__(settings, SimpleNamespace(world=self.wire, command=machine.command))
        self.truth = log

    def proven(self):
        """Both signs proven, as on any real bus."""
        self.until_ready()
        for axis in AXES:
            single_axis_run(self, Mode.COMMISSION, axis)
            witnessed = ModeRequest(Mode.COMMISSION, axis=axis, witnessed=True)
            self.execute(RequestKind.MODE, witnessed)
        return self


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """A session from power-on to a stride and a half, and through the loss of the bench's drive.

    The EPOS4 of the bench has no objects but those of its maker's EDS.
    """
    before = get_scheduler()
    session = Bench(tmp_path_factory.mktemp("bench"))
    session.unproven = session.until_ready().request(RequestKind.ENABLE)
    session.proven().enable()
    session.run(0.5)
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=0.7, duration_s=60.0)
    session.execute(RequestKind.MODE, gait)
    session.run_until(lambda record: record.gait_phase >= 0, 20)
    session.walks_from = len(session.records)
    session.run(5.0)
    session.walks_to = len(session.records)
    session.motor.hip.wire.cut = True
    session.run_until(lambda record: not record.mode.active, 0.5)
    session.run(0.5)
    yield session
    set_scheduler(before)


def test_the_signs_must_be_proven_though_one_drive_is_virtual(walked):
    assert walked.unproven.outcome == Outcome.REFUSED
    assert walked.unproven.refusal == Refusal(RefusalCode.SIGN_NOT_PROVEN, AXES[0])
    ready = next(record for record in walked.records if record.mode == Mode.READY)
    assert not any(drive.sign_proven for drive in ready.drives)


def test_both_walk_and_the_virtual_leg_goes_with_the_motor_of_the_bench(walked):
    records = walked.records[walked.walks_from : walked.walks_to]
    rows = {row.sync_mono_ns: row for row in walked.truth.rows}
    hips = np.array([record.drives[0].position for record in records])
    slides = np.array([record.drives[1].position for record in records])
    true = [rows[record.sync_mono_ns] for record in records]

    assert {record.mode for record in records} == {Mode.GAIT}
    assert {record.verdict.cause for record in records} == {Cause.NONE}
    assert {drive.sample_age_cycles for record in records for drive in record.drives} == {0}
    assert np.ptp(hips) > 0.25
    assert np.ptp(slides) > 0.3
    assert slides == pytest.approx([row.slide_position_m for row in true], abs=3e-4)
    # Two cycles late: the hip of the virtual leg is where the bench's was.
    assert [row.hip_angle_rad for row in true[2:]] == pytest.approx(hips[:-2], abs=2e-4)


def test_the_bench_has_no_object_that_its_maker_s_file_lacks(walked):
    has = walked.motor.hip.dictionary

    assert 0x607C not in has
    for index in (0x1800, 0x1801, 0x1802):
        with pytest.raises(KeyError):
            has.lookup(index, 5)


def test_the_temperature_of_the_bench_s_drive_is_read(walked):
    records = walked.records[walked.walks_from : walked.walks_to]

    assert {record.drives[0].temperature_degc for record in records} == {0.0}


def test_a_bare_motor_is_no_patient(walked):
    legs = [record.legs[0] for record in walked.records[walked.walks_from : walked.walks_to]]
    hip = [leg.hip.patient for leg in legs if leg.hip.validity == 0]

    assert len(hip) > 200
    assert np.sqrt(np.mean(np.square(hip))) < 1.0


def test_the_loss_of_the_bench_s_drive_stops_the_virtual_one_by_its_quick_stop(walked):
    stopped = walked.records[-1]

    assert (stopped.mode, stopped.verdict.cause) == (Mode.FAULT, Cause.DRIVE_SILENT)
    assert stopped.verdict.drive == "right/hip"
    assert stopped.drives[1].power_state == PowerState.QUICK_STOP_ACTIVE
    assert abs(walked.truth.rows[-1].slide_velocity_m_per_s) < 0.01
    assert walked.truth.rows[-1].hip_velocity_rad_per_s == 0.0


def test_the_virtual_drives_never_send_for_the_one_of_the_bench(walked):
    of_the_bench, virtual = ({frame.can_id for frame in sent} for sent in walked.wire.sent)

    assert {0x186, 0x286, 0x386, 0x586, 0x706} <= virtual <= OF_THE_SLIDE
    assert {0x185, 0x285, 0x585, 0x705} <= of_the_bench
    assert not of_the_bench & OF_THE_SLIDE
