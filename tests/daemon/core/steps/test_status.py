"""Stage and progress as they are published, of bring-up, single axis, hold and exercise."""

from types import SimpleNamespace

import pytest
from gaitd_names import AxisStep, Mode, ProgressCode, Stage
from step_inputs import a_core, a_leg

from daemon.core.steps import status
from daemon.ipc.report import Progress

HOMES = SimpleNamespace(stage=Stage.PLAYING, axis="right/hip", step=AxisStep.SEARCHING)
PLAYED = Progress(ProgressCode.EXERCISING, "", (3.0,))
PLAYS = SimpleNamespace(stage=Stage.PLAYING, legs_in_turn=False, progress=lambda: PLAYED)
SETTING_UP = Progress(ProgressCode.SETTING_UP)


@pytest.mark.parametrize(
    ("mode", "exercise", "changes", "stage", "progress"),
    [
        (Mode.STOPPING, PLAYS, {}, None, None),
        (Mode.FAULT, PLAYS, {}, None, None),
        (Mode.OFF, None, {}, None, None),
        (Mode.BRINGING_UP, None, {}, Stage.PREPARING, None),
        (Mode.BRINGING_UP, None, {"bring_up": SETTING_UP}, Stage.PREPARING, SETTING_UP),
        (
            *(Mode.REFERENCE, None, {"single_axis": HOMES}, Stage.PLAYING),
            Progress(ProgressCode.ONE_AXIS, "right/hip", (AxisStep.SEARCHING,)),
        ),
        (Mode.HOLD, None, {}, None, None),
        (
            *(Mode.HOLD, None, {"load_checked": False}, Stage.PREPARING),
            Progress(ProgressCode.COMPARING_LOAD),
        ),
        (Mode.GAIT, None, {"load_checked": False}, None, None),
        (Mode.TORQUE, PLAYS, {"load_checked": False}, Stage.PLAYING, PLAYED),
        (Mode.TORQUE, None, {"load_checked": False}, None, None),
        (Mode.READY, None, {}, None, None),
        (Mode.READY, PLAYS, {}, Stage.PLAYING, None),
    ],
)
def test_stage_and_progress_follow_from_mode_and_what_moves(
    mode, exercise, changes, stage, progress
):
    core = a_core(a_leg(exercise=exercise), mode=mode, **changes)

    assert (status.stage(core), status.progress(core)) == (stage, progress)
