"""A minute with a passive patient in a machine whose file has a lighter leg: what is left over."""

from dataclasses import replace

import numpy as np
from gaitd_names import EventCode, Mode, RequestKind, Stage
from msgspec.structs import replace as replace_fields
from sessions import CONFIGS, briefly_announced

from daemon.config.robot import friction_parameters, leg_parameters
from daemon.ipc.record import ModeRequest
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession
from observer.filter.status import Status, Validity
from observer.mechanism.friction import static_friction_of
from observer.mechanism.linkage import dynamics


def walked():
    """Walked with a baseline by a passive patient, and without one by an active one."""
    settings = load(CONFIGS / "demo.toml")
    patient = settings.robot.patient
    light = replace_fields(patient, mass_kg=0.85 * patient.mass_kg)
    settings = replace(settings, robot=replace_fields(settings.robot, patient=light))
    made = LockstepSession(briefly_announced(settings)).enable()
    made.command("patient passive")
    wanted = ModeRequest(Mode.GAIT, 0.5, 1.0, duration_s=26.0, baseline=True)
    made.execute(RequestKind.MODE, wanted)
    made.run_until(lambda record: record.stage is Stage.OVER or record.mode == Mode.HOLD, 60)
    made.command("patient active")
    made.execute(RequestKind.MODE, ModeRequest(Mode.GAIT, 0.4, 1.0, duration_s=60.0))
    made.run_until(lambda record: record.gait_phase >= 0, 20)
    made.run(8)
    return made


def errors(session, records):
    true = {row.sync_mono_ns: row for row in session.truth.rows}
    found = []
    for record in records:
        hip, slide = record.legs[0].hip, record.legs[0].slide
        if (hip.validity, slide.validity) != (Validity.OK, Validity.OK):
            continue
        row = true[record.sync_mono_ns]
        found.append(
            (
                (hip.patient - row.hip_patient_nm, hip.patient_std),
                (slide.patient - row.slide_patient_n, slide.patient_std),
            )
        )
    return np.moveaxis(np.array(found), -1, 0)


def test_what_follows_the_minute_is_relative_to_it_and_right():
    session = walked()
    is_reported_and_what_follows_is_right(session)
    need_holds_what_the_minute_explains(session)
    strides_say_whether_it_was_taken_off(session)


def is_reported_and_what_follows_is_right(session):
    events = [
        (number, event)
        for number, record in enumerate(session.records)
        for event in record.events
        if event.code in {EventCode.BASELINE_BEGUN, EventCode.BASELINE_TAKEN}
    ]

    (begun, _), (taken, told) = events
    during, later = session.records[taken - 1000 : taken - 50], session.records[-600:]
    assert told.subject == "right"
    assert not any(Status.BASELINE & record.legs[0].status for record in session.records[:begun])
    assert all(Status.BASELINE & record.legs[0].status for record in later)
    (before, before_std), (after, after_std) = errors(session, during), errors(session, later)
    assert (np.abs(before) > 2.0)[:, 0].mean() > 0.8
    assert (np.sqrt(np.mean(after**2, axis=0)) < (0.6, 3.0)).all()
    assert (np.abs(after) < 3.0 * after_std).mean() > 0.99
    assert (after_std.mean(axis=0) < 0.5 * before_std.mean(axis=0)).all()


def surplus(session, records):
    """Published need less what this machine's leg needs beyond the load that the drives carry."""
    carried, true = leg_parameters(session.settings.robot), load(CONFIGS / "demo.toml").robot
    axes = [record.legs[0].axes for record in records]
    poses = np.array([[axis.reference_position for axis in pair] for pair in axes])
    needed = np.array([[axis.needed for axis in pair] for pair in axes])[2:]
    speeds = np.gradient(poses, 0.01, axis=0)
    accelerations = np.gradient(speeds, 0.01, axis=0)
    expected = []
    for pose, speed, acceleration in zip(poses, speeds, accelerations, strict=True):
        moving = dynamics(leg_parameters(true), *pose, *speed, 1.0)
        load_ = dynamics(carried, *pose, 0.0, 0.0, 0.0)
        mass = np.array([[moving.m11, moving.m12], [moving.m12, moving.m22]])
        bias = moving.bias_hip - load_.bias_hip, moving.bias_slide - load_.bias_slide
        laws = zip(friction_parameters(true), speed, strict=True)
        expected.append(mass @ acceleration + bias + [static_friction_of(*law) for law in laws])
    return needed - expected[1:-1]


def need_holds_what_the_minute_explains(session):
    (taken,) = [
        number
        for number, record in enumerate(session.records)
        if any(event.code is EventCode.BASELINE_TAKEN for event in record.events)
    ]
    before = surplus(session, session.records[taken - 500 : taken - 50])
    after = surplus(session, session.records[-600:])

    assert np.sqrt(np.mean(before**2, axis=0))[0] > 2.0
    assert (np.sqrt(np.mean(after**2, axis=0)) < (1.0, 10.0)).all()


def strides_say_whether_it_was_taken_off(session):
    strides = [record.legs[0].stride for record in session.records if record.legs[0].stride]

    assert not strides[3].baseline_subtracted
    assert strides[-1].baseline_subtracted
