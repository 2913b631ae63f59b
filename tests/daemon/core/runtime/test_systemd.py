"""The words for systemd and the journal."""

import pytest

from daemon.core.runtime.systemd import status_line
from daemon.ipc.record import Cause, Mode, StopCategory, Verdict

SILENT = Verdict(StopCategory.S1, Cause.DRIVE_SILENT, "right/hip", said="no\nanswer")
STOPPED = Verdict(StopCategory.S2, Cause.STOP_REQUESTED)


@pytest.mark.parametrize(
    ("mode", "verdict", "progress", "line"),
    [
        (Mode.READY, Verdict(), "ready", "ready"),
        (Mode.BRINGING_UP, Verdict(), "bringing up", "bringing_up"),
        (Mode.BRINGING_UP, Verdict(), "3/168 right/hip boot", "bringing_up: 3/168 right/hip boot"),
        (Mode.GAIT, Verdict(), "gait: playing for 3 s", "gait: playing for 3 s"),
        (Mode.STOPPING, STOPPED, "stopping", "stopping [stop_requested]"),
        (Mode.FAULT, SILENT, "no\nanswer", "fault: no answer [drive_silent right/hip]"),
    ],
)
def test_a_status_is_one_line_with_mode_progress_and_cause(mode, verdict, progress, line):
    assert status_line(mode, verdict, progress) == line
