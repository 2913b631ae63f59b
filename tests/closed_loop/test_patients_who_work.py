"""Patients who work are not taken for a spasm or clonus; a spasm and clonus still are.

`gaitd patients` plays all of them; these are the cells in which effort against the motion rises
most within the window of the spasm monitor.
"""

import numpy as np
import pytest
from gaitd_names import Cause, EventCode, Mode, StopCategory
from sessions import CONFIGS, briefly_announced, reported

from daemon.ipc.report import Event
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.lockstep_gateway import Gateway
from gaitd_lab.patients import (
    DT_S,
    Gait,
    Late,
    Model,
    Patient,
    Spasm,
    clonic,
    of_ability,
    trembling,
)
from gaitd_lab.virtual_machine import virtual_machine

CONFIG = CONFIGS / "demo.toml"
MUSCLE_RISE_S = 0.06
"""Until 30 N·m, risen in 60 ms behind an activation of 40 ms, have the 14 N·m of [spasm]."""


def session_of(model: Model) -> LockstepSession:
    """A session with a patient who reacts to the gait."""
    settings = briefly_announced(load(CONFIG))
    machine = virtual_machine(settings.file)
    trainer = machine.trainers[settings.legs[0].name]
    patient = Patient(settings.robot, model, seed=1)
    gateway = Gateway(lambda record: trainer.exert(*patient(record)))
    return LockstepSession(settings, machine, gateway=gateway)


def clonus_events(session: LockstepSession) -> list[Event]:
    return reported(session.records, EventCode.CLONUS_BEGUN)


@pytest.mark.parametrize(
    ("model", "cadence_hz", "at_s"),
    [
        (Late(of_ability(1.0)), 0.35, 6.0),
        *(
            pytest.param(of_ability(0.5), 0.25, at_s, marks=pytest.mark.thorough)
            for at_s in np.arange(9.0, 13.0, 0.25)
        ),
    ],
)
def test_a_spasm_of_a_patient_who_works_stops_at_every_phase_within_window_and_patience(
    model, cadence_hz, at_s
):
    """One who brakes the leg before its turns walks on until then."""
    spasm = Spasm(at_s)

    def with_spasm(gait: Gait) -> np.ndarray:
        return model(gait) + spasm(gait)

    session = session_of(with_spasm).walk(cadence_hz=cadence_hz, duration_s=at_s - 0.1)
    walking = session.record.mode == Mode.GAIT
    rules = load(CONFIG).limits.spasm

    session.run_until(lambda record: record.mode != Mode.GAIT, within_s=0.7)

    assert walking
    assert session.record.verdict.cause == Cause.SPASM
    strides_s = DT_S * sum(record.gait_phase >= 0 for record in session.records)
    found_s = strides_s - at_s - MUSCLE_RISE_S
    assert 0.0 < found_s <= (rules.rise_window_ms + rules.patience_ms) / 1000


def test_clonus_softens_guidance_and_stops_when_its_bursts_sum_up():
    """Bursts of 0.7 s every 2 s: 1.5 s are full in the fourth one, which ends at 6.7 s."""
    session = session_of(clonic).walk(duration_s=3.0)  # its first whole burst is over
    leg = session.core.legs[0]
    goes_on, softened_ratio, told = (
        session.record.mode,
        leg.softened.clonus_ratio,
        clonus_events(session),
    )

    session.run_until(lambda record: record.mode != Mode.GAIT, within_s=3.8)

    verdict = session.record.verdict
    assert (verdict.cause, verdict.category) == (Cause.CLONUS, StopCategory.S2)
    assert goes_on == Mode.GAIT
    assert softened_ratio < 1.0
    assert told
    assert len(clonus_events(session)) <= len(leg.axes)


def test_a_tremor_is_not_taken_for_clonus():
    session = session_of(trembling).walk(cadence_hz=0.5, duration_s=4.0)

    assert session.record.mode == Mode.GAIT
    assert not clonus_events(session)
