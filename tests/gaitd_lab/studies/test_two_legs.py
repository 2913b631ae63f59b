"""Studies on a machine with two legs: each leg beside its own truth."""

import numpy as np

from gaitd_lab.studies import working_patients
from gaitd_lab.studies.working_patients import Cell, play_legs, table
from gaitd_lab.trials import Situation, Trials
from sim_drives.plant.settings import FrictionLaw

FILE = "two_legs.toml"


def test_the_trial_of_each_leg_has_its_own_truth(soon):
    trials = Trials(soon / FILE)
    walks = trials.gait_of_legs(Situation(cadence_hz=0.5), 2.0)

    assert tuple(walks) == trials.legs == ("right", "left")
    right, left = (walk.recording.position for walk in walks.values())
    assert np.nanmax(np.abs(right - left)[:, 0]) > 0.02
    for walk in walks.values():
        assert np.nanmax(np.abs(walk.recording.position - walk.truth[:, :2])) < 1e-3


def test_a_spasm_in_one_leg_stops_both_and_each_leg_has_its_row(soon, monkeypatch):
    monkeypatch.setattr(working_patients, "SPASM_AT_S", 3.0)

    legs = play_legs(soon / FILE, Cell("spasm", 0.25, FrictionLaw.PAPER, 1), 6.0)

    assert [(one.leg, one.cause) for one in legs] == [("right", "SPASM"), ("left", "SPASM")]
    assert legs[0].hip.patient_si < 5.0 < legs[1].hip.patient_si
    names = [row[0] for row in table("Medians", legs).rows]
    assert names == ["spasm, right leg", "spasm, left leg"]
