"""A person who moves the leg against its drive is no wiring fault, and hides none.

`tests/daemon/core/safety/test_sign_response.py` has the rule; `gaitd patients` plays all patients.
"""

import numpy as np
import pytest
from gaitd_names import Cause, Mode, RequestKind, StopCategory
from records import both
from sessions import CONFIGS, briefly_announced, changed_configs, new_session

from daemon.config.robot import leg_parameters
from daemon.ipc.record import ModeRequest
from daemon.preflight.load import load
from drives.signals import PowerState
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.lockstep_gateway import Gateway
from gaitd_lab.patients import Patient, of_ability
from gaitd_lab.proven_signs import proven_signs
from gaitd_lab.virtual_machine import virtual_machine
from observer.mechanism.mechanism import singularity_ratio

CADENCE_HZ = 0.5
SLIDE = "right/slide"


def walking(ability):
    """A session in which a patient of this ability has begun to walk."""
    settings = briefly_announced(load(CONFIGS / "demo.toml"))
    machine = virtual_machine(settings.file, seed=1)
    trainer = machine.trainers["right"]
    patient = Patient(settings.robot, of_ability(ability), seed=1)
    session = LockstepSession(
        settings,
        machine,
        gateway=Gateway(lambda record: trainer.exert(*patient(record))),
        persistent=proven_signs(settings, machine),
    )
    return session.walk(cadence_hz=CADENCE_HZ)


@pytest.fixture(scope="module")
def warm_strong():
    """A patient who gives more than the need has walked for two strides."""
    session = walking(1.4)
    session.run(4.0)
    return session


def stops(session, within_s):
    """Walk on until a stop."""
    return session.run_until(lambda record: record.mode != Mode.GAIT, within_s).verdict


def test_a_patient_who_gives_more_than_the_need_walks_on(warm_strong):
    warm_strong.run(2.0)

    assert warm_strong.record.mode == Mode.GAIT


def test_a_person_is_the_cause_where_the_response_is_unclear_and_both_axes_are_held():
    session = walking(2.5)

    verdict = stops(session, within_s=4.5)
    session.run(0.2)

    assert (verdict.cause, verdict.drive) == (Cause.MOVED_AGAINST_DRIVE, SLIDE)
    assert verdict.category == StopCategory.S1
    assert session.record.verdict == verdict
    assert {one.power_state for one in session.record.drives} == {PowerState.QUICK_STOP_ACTIVE}
    assert session.core.axes[1].sensed.sign_trusted


@pytest.mark.parametrize(
    ("fault", "later_s"),
    [("wrong_sign", 0.0), ("encoder_reversed", 0.3)],
)
def test_a_real_reversal_is_found_while_a_strong_patient_works(warm_strong, fault, later_s):
    session = warm_strong
    session.run(later_s)
    session.command(f"{fault} {SLIDE}")
    begun = len(session.records)

    verdict = stops(session, within_s=0.3)
    session.run(0.05)

    assert Cause.SIGN_WRONG in {verdict.cause, session.record.verdict.cause}
    assert session.record.verdict.category == StopCategory.S0
    assert len(session.records) - begun < 30
    assert not session.core.axes[1].sensed.sign_trusted


def test_a_wrong_sign_is_found_also_where_the_drives_hold_a_stretched_leg(tmp_path):
    """A person stretches the leg until it is stopped below `stop_ratio`, here a wide one."""
    configs = changed_configs(
        tmp_path,
        ("limits.toml", "soft_ratio = 0.3", "soft_ratio = 0.5"),
        ("limits.toml", "stop_ratio = 0.15", "stop_ratio = 0.3"),
        ("plant.toml", "slide.position_m = 0.5905", "slide.position_m = 0.75"),
    )
    session = new_session(configs).enable()
    session.execute(RequestKind.MODE, ModeRequest(Mode.HAND_GUIDING))
    session.run(0.3)
    session.machine.trainers["right"].exert(0.0, 320.0)
    session.run(1.5)
    held = session.record
    leg = leg_parameters(session.settings.robot)
    assert singularity_ratio(leg, np.array(both(held.legs[0], "measured_position"))) < 0.3
    assert {drive.power_state for drive in held.drives} == {PowerState.QUICK_STOP_ACTIVE}

    session.command(f"wrong_sign {SLIDE}")
    session.run(0.05)

    verdict = session.record.verdict
    assert (verdict.cause, verdict.category) == (Cause.SIGN_WRONG, StopCategory.S0)
    assert {d.power_state for d in session.record.drives} == {PowerState.SWITCH_ON_DISABLED}


def trust(session):
    return [axis.sensed.sign_trusted for axis in session.core.axes]


def doubts(session):
    """What a later core finds."""
    stored = session.state_file.persistent
    return [stored.axis(axis.name).proof.doubted for axis in session.core.axes]


def test_a_drive_that_rebooted_is_in_doubt():
    settings = load(CONFIGS / "demo.toml")
    machine = virtual_machine(settings.file, seed=1)
    session = LockstepSession(settings, machine, persistent=proven_signs(settings, machine))
    session.until_ready()
    assert trust(session) == [True, True]

    session.command(f"reboot {SLIDE}")
    session.run(0.5)
    assert trust(session) == [True, False]
    session.until_ready()
    assert trust(session) == [True, False]
    assert all(axis.sign_proven for axis in session.core.axes)

    assert doubts(session) == [False, True]
