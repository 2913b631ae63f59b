"""A whole session in simulated time, with the service and its virtual drives."""

import time

import pytest
from gaitd_client import Trainer
from gaitd_session import Advice, Button, Phase, Session, open_history
from training import profile

from daemon.ipc.record import Cause, Mode

QUICK = {
    "demo.toml": {
        "gait.announce_s": 0.5,
        "gait.approach_hip_rad_per_s": 0.4,
        "gait.approach_slide_m_per_s": 0.3,
        "self_test.required": "daily",
    }
}


class Patient:
    """Presses START wherever the view offers it, and notes the phases that a display shows."""

    def __init__(self, session, trainer):
        self.session, self.trainer = session, trainer
        self.views = []

    def until(self, reached, within_s=90.0, presses=True):
        end_ns = self.trainer.clock.now_ns() + within_s * 1e9
        while self.trainer.clock.now_ns() < end_ns:
            view = self.session.view()
            if not self.views or self.views[-1].phase is not view.phase:
                self.views.append(view)
            if reached(view):
                return view
            if presses and view.buttons[:1] == (Button.START,):
                self.session.press(Button.START)
            time.sleep(0.02)
        raise AssertionError(f"not reached: {view}")


@pytest.mark.virtual_trainer(QUICK)
def test_a_session_from_the_first_press_to_the_end_with_a_stop_in_it(virtual_trainer, tmp_path):
    history = open_history(tmp_path / "history.sqlite")
    clock = virtual_trainer.clock
    with (
        Trainer(virtual_trainer.endpoint, clock=clock) as trainer,
        Session(trainer, profile(), history, clock) as session,
    ):
        patient = Patient(session, virtual_trainer)
        patient.until(lambda view: view.phase is Phase.FINISHED, 200)
    for view in patient.views:
        print(view)
    print(history.store.summaries(profile().id), history.store.strides(profile().id))
