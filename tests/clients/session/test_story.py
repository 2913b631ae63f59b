"""A session in simulated time, with the service and its virtual drives."""

import csv
import time
from pathlib import Path

import pytest
from gaitd_client import Cause, Trainer
from gaitd_names import Mode
from gaitd_session import (
    Advice,
    Button,
    Phase,
    Session,
    Store,
    machine,
    open_history,
    parse_profile,
)
from gaitd_session.export import export
from gaitd_session.machine import LEFT_MIN_S
from training import PROFILE

FOLLOWED_S = 60.0
WALKED_S = 7.0
"""The warm-up, the shortest with a whole stride behind the stop."""
ANNOUNCED_S = 1.5
"""Half the time of the client: long enough for the leg to be held at rest."""
BRIEF = parse_profile(
    PROFILE.replace("duration_s = 10.0", f"duration_s = {WALKED_S}"), Path("profile.toml")
)


def quick(required):
    """Edits of the configuration: less waiting, and whether the service wants a daily test."""
    return {
        "demo.toml": {
            "gait.announce_s": 0.5,
            "gait.ramp_strides": 1,
            "gait.hip.approach_rad_per_s": 0.8,
            "gait.slide.approach_m_per_s": 0.6,
            "self_test.required": required,
            "self_test.hip.speed_rad_per_s": 0.15,
            "self_test.slide.speed_m_per_s": 0.1,
        }
    }


class Patient:
    """Does what the view says, and notes the phases that a display has shown."""

    def __init__(self, session, virtual):
        self.session, self.virtual = session, virtual
        self.phases = []
        self.view = session.view()
        self.actions = {
            Advice.PRESS_START: lambda: session.press(Button.START),
            Advice.PRESS_START_TO_RESET: lambda: session.press(Button.START),
            Advice.TRY_AGAIN_OR_CALL_THERAPIST: lambda: session.press(Button.START),
            Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT: lambda: self.act("sto_open * 0.3"),
            Advice.LET_GO_AND_HOLD_HAND_SWITCH: lambda: self.act("hand_switch_open * 0.3"),
            Advice.CALL_FOR_HELP: self.helped,
        }

    def act(self, fault):
        self.virtual.tell(fault)
        self.virtual.run(0.5)
        self.session.press(Button.START)

    def helped(self):
        """What a display offers, or a helper does, after a stop that holds the leg."""
        if self.virtual.mode == Mode.FAULT:
            self.virtual.reset()

    def until(self, reached):
        end_ns = self.virtual.clock.now_ns() + FOLLOWED_S * 1e9
        while self.virtual.clock.now_ns() < end_ns:
            self.view = self.session.view()
            if self.phases[-1:] != [self.view.phase]:
                self.phases.append(self.view.phase)
            if reached(self.view):
                return
            self.actions.get(self.view.advice, lambda: None)()
            time.sleep(0.1)
        raise AssertionError(f"not reached: {self.view}, after {self.phases}")


@pytest.mark.parametrize(
    "required",
    [
        "never",
        # Hand switch and emergency stop must be seen to act, which stops the trainer once.
        pytest.param("daily", marks=pytest.mark.thorough),
    ],
)
def test_a_patient_who_does_as_told_passes_the_test_walks_is_stopped_and_goes_on(
    virtual_trainers, tmp_path, required, monkeypatch
):
    monkeypatch.setattr(machine, "ANNOUNCE_S", ANNOUNCED_S)
    virtual_trainer = virtual_trainers(quick(required))
    file = tmp_path / "history.sqlite"
    history = open_history(file)
    clock = virtual_trainer.clock
    with (
        Trainer(virtual_trainer.endpoint, clock=clock) as trainer,
        Session(trainer, BRIEF, history, clock) as session,
    ):
        patient = Patient(session, virtual_trainer)
        patient.until(
            lambda view: view.phase is Phase.WALKING and 0 < view.block_left_s < WALKED_S - 1
        )
        assert Phase.SELF_TEST in patient.phases
        virtual_trainer.stop()
        patient.until(lambda view: view.phase is Phase.STOPPED)
        assert patient.view.cause == Cause.STOP_REQUESTED
        patient.until(lambda view: view.phase is Phase.PAUSED)
        assert 0 < patient.view.block_left_s < WALKED_S - 1
        patient.until(lambda view: view.phase is Phase.REST)
        assert patient.view.block.number == 2
        session.press(Button.END)
        patient.until(lambda view: not view.buttons)
        assert (patient.view.phase, patient.view.history_trouble) == (Phase.FINISHED, "")
        virtual_trainer.wait_for(Mode.READY)
    history.store.close()

    with Store(file, is_writer=False) as store:
        (summary,) = store.summaries(BRIEF.id)
        strides = store.strides(BRIEF.id)
        assert store.self_test_utc_ns(BRIEF.id) > summary.begun_utc_ns
        assert 0.1 <= store.middles(BRIEF.id)["right"] <= 0.6
    assert summary.end == "ended"
    # A block with less left than LEFT_MIN_S is complete; time without a signal is not walked.
    assert WALKED_S - LEFT_MIN_S <= summary.walked_s < WALKED_S + 7.0
    assert summary.stride_count == len(strides) >= 1
    assert summary.interruption_count >= 1
    export(strides, tmp_path / "strides.csv")
    with (tmp_path / "strides.csv").open(encoding="utf-8") as opened:
        rows = list(csv.DictReader(opened))
    assert {row["kind"] for row in rows} == {"warm_up"}
    assert all(1.5 < float(row["duration_s"]) < 6.0 for row in rows)
