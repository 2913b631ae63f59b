"""The words for systemd and the journal."""

import pytest
from msgspec.structs import replace
from records import record

from daemon.core.runtime.systemd import status_line
from daemon.ipc.record import Cause, Mode, Stage, StopCategory, Verdict
from daemon.ipc.report import Progress, ProgressCode

SILENT = Verdict(StopCategory.S1, Cause.DRIVE_SILENT, "right/hip", said="no\nanswer")
STOPPED = Verdict(StopCategory.S2, Cause.STOP_REQUESTED)
SET_UP = Progress(ProgressCode.SETTING_UP, "right/hip", (3, 168))


@pytest.mark.parametrize(
    ("mode", "stage", "verdict", "progress", "line"),
    [
        (Mode.READY, None, Verdict(), None, "ready"),
        (
            *(Mode.BRINGING_UP, Stage.PREPARING, Verdict(), SET_UP),
            "bringing_up preparing setting_up right/hip done_count=3 total_count=168",
        ),
        (
            *(Mode.GAIT, Stage.PLAYING, Verdict(), Progress(ProgressCode.EXERCISING, "", (3.0,))),
            "gait playing exercising elapsed_s=3",
        ),
        (Mode.STOPPING, None, STOPPED, None, "stopping [stop_requested]"),
        (Mode.FAULT, None, SILENT, None, "fault [drive_silent right/hip]"),
    ],
)
def test_a_status_is_one_line_with_mode_stage_progress_and_cause(
    mode, stage, verdict, progress, line
):
    now = replace(record(1), mode=mode, stage=stage, verdict=verdict, progress=progress)

    assert status_line(now) == line
