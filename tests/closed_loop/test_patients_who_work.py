"""Patients who work are not taken for a spasm; a spasm of one who works still is one.

`gaitd patients` plays all of them; these are the cells in which effort against the motion rises
most within the window of the spasm monitor.
"""

import numpy as np
import pytest
from sessions import CONFIGS

from daemon.ipc.record import Cause, Mode
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.lockstep_gateway import Gateway
from gaitd_lab.patients import DT_S, Gait, Patient, Spasm, of_ability
from gaitd_lab.virtual_machine import virtual_machine
from gaitd_lab.working_patients import Cell, play
from sim_drives.plant.settings import FrictionLaw

CONFIG = CONFIGS / "demo.toml"


@pytest.mark.parametrize(
    ("patient", "cadence_hz", "law"),
    [
        ("late", 0.35, FrictionLaw.PAPER),
        pytest.param("all", 0.35, FrictionLaw.LUGRE, marks=pytest.mark.thorough),
        pytest.param("weak phase", 0.35, FrictionLaw.PAPER, marks=pytest.mark.thorough),
        pytest.param("1.4", 0.3, FrictionLaw.PAPER, marks=pytest.mark.thorough),
    ],
)
def test_a_patient_who_brakes_the_leg_before_its_turns_walks_on(patient, cadence_hz, law):
    played = play(CONFIG, Cell(patient, cadence_hz, law, 1), 16.0)

    assert not played.cause


@pytest.mark.parametrize(
    "at_s", [9.0, 10.0, *(pytest.param(at_s, marks=pytest.mark.thorough) for at_s in (11.0, 12.0))]
)
def test_a_spasm_of_a_patient_who_works_stops_within_half_a_second(at_s):
    spasm, half = Spasm(at_s), of_ability(0.5)

    def model(gait: Gait) -> np.ndarray:
        return half(gait) + spasm(gait)

    settings = load(CONFIG)
    machine = virtual_machine(settings.file)
    trainer = machine.trainers[settings.legs[0].name]
    patient = Patient(settings.robot, model, seed=1)
    gateway = Gateway(lambda record: trainer.exert(*patient(record)))
    session = LockstepSession(settings, machine, gateway=gateway).walk(duration_s=at_s - 0.1)
    walking = session.record.mode == Mode.GAIT

    session.run_until(lambda record: record.mode != Mode.GAIT, within_s=0.7)

    assert walking
    assert session.record.verdict.cause == Cause.SPASM
    strides_s = DT_S * sum(record.gait_phase >= 0 for record in session.records)
    assert strides_s - at_s == pytest.approx(0.48, abs=0.03)
