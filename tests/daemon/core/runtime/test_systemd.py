"""The words for systemd and the journal."""

import pytest
from gaitd_names import Cause, Mode, ProgressCode, Stage, StopCategory
from msgspec.structs import replace
from records import record

from daemon.core.runtime.texts import status_text
from daemon.ipc.record import Verdict
from daemon.ipc.report import Progress

SILENT = Verdict(StopCategory.S1, Cause.DRIVE_SILENT, "right/hip", said="no\nanswer")
STOPPED = Verdict(StopCategory.S2, Cause.STOP_REQUESTED)
SET_UP = Progress(ProgressCode.SETTING_UP, "right/hip", (3, 168))


@pytest.mark.parametrize(
    ("mode", "stage", "verdict", "progress", "line"),
    [
        (Mode.READY, None, Verdict(), None, "Ready, drives off [ready]"),
        (
            *(Mode.BRINGING_UP, Stage.PREPARING, Verdict(), SET_UP),
            "Machine gets ready, is prepared, step 3 of 168 right, hip [bringing_up]",
        ),
        (
            *(Mode.GAIT, Stage.PLAYING, Verdict(), Progress(ProgressCode.EXERCISING, "", (3.0,))),
            "Walking, runs, for 3 s [gait]",
        ),
        (
            *(Mode.STOPPING, None, STOPPED, None),
            "Stopping: STOP was pressed, or a program requested a stop [stopping stop_requested]",
        ),
        (
            *(Mode.FAULT, None, SILENT, None),
            "Stopped: right, hip: A drive does not answer: no answer "
            "[fault drive_silent right/hip]",
        ),
    ],
)
def test_a_status_is_one_line_with_mode_stage_progress_and_cause(
    mode, stage, verdict, progress, line
):
    now = replace(record(1), mode=mode, stage=stage, verdict=verdict, progress=progress)

    assert status_text(now) == line
