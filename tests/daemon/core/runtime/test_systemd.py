"""The words for systemd and the journal."""

from types import SimpleNamespace

import pytest
from fresh_core import fresh, show
from gaitd_names import Cause, EventCode, ExitCode, Mode, ProgressCode, Stage, StopCategory
from msgspec.structs import replace
from records import record
from safety_inputs import FEEDBACK

from daemon.core.runtime.systemd import (
    ERROR,
    INFORMATIONAL,
    NOTICE,
    WARNING,
    Supervision,
    final_state_text,
)
from daemon.core.runtime.texts import event_text, one_line, status_text, verdict_text
from daemon.core.safety.stop_sequence import Step
from daemon.ipc.record import Verdict
from daemon.ipc.report import Event, Progress
from drives.signals import PowerState

SILENT = Verdict(StopCategory.S1, Cause.DRIVE_SILENT, "right/hip", said="no\nanswer")
STOPPED = Verdict(StopCategory.S2, Cause.STOP_REQUESTED)
SET_UP = Progress(ProgressCode.SETTING_UP, "right/hip", (3, 168))


@pytest.mark.parametrize(
    ("mode", "stage", "verdict", "progress", "line"),
    [
        (Mode.READY, None, Verdict(), None, "Ready, drives off [ready]"),
        (
            *(Mode.BRINGING_UP, Stage.PREPARING, Verdict(), SET_UP),
            "Machine gets ready, is prepared, "
            "setting up the drives: 3 of 168 steps done (right, hip) [bringing_up]",
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


def test_an_event_is_a_sentence_of_the_operator():
    event = Event(EventCode.MEMORY_NOT_LOCKED, values=(8192,), said="not permitted")

    assert "8192" in event_text(event)
    assert "not permitted" in event_text(event)


class Systemd:
    """systemd and the journal at once; `is_full`: the former takes nothing."""

    def __init__(self):
        self.sent, self.written, self.is_full = [], [], False

    def send(self, *lines):
        self.sent.append(lines)
        return not self.is_full

    def write(self, *line):
        self.written.append(line)


@pytest.fixture
def systemd():
    return Systemd()


@pytest.fixture
def supervision(systemd):
    return Supervision(systemd, systemd, "the leg sinks")


READY = replace(record(7), mode=Mode.READY)


def walks(cycle):
    """A record of a gait, whose progress differs in each cycle."""
    return replace(record(cycle), progress=Progress(ProgressCode.EXERCISING, "", (cycle,)))


WALKS = walks(8)


def test_a_change_is_told_at_once_and_progress_rarely(systemd, supervision):
    supervision.feed()
    for one in (
        *(READY, READY, WALKS, walks(8 + 499), walks(8 + 500), walks(8 + 999), walks(8 + 1001)),
        *(replace(WALKS, verdict=SILENT), READY),
    ):
        supervision.report(one)

    assert systemd.sent == [
        ("WATCHDOG=1",),
        ("READY=1", f"STATUS={status_text(READY)}"),
        (f"STATUS={status_text(WALKS)}",),
        (f"STATUS={status_text(walks(8 + 500))}",),
        (f"STATUS={status_text(walks(8 + 1001))}",),
        (f"STATUS={status_text(replace(WALKS, verdict=SILENT))}",),
        (f"STATUS={status_text(READY)}",),
    ]
    assert [line[1] for line in systemd.written] == [NOTICE, NOTICE, WARNING, NOTICE]
    assert (ERROR, WARNING, NOTICE, INFORMATIONAL) == (3, 4, 5, 6)  # of syslog(3)


def test_what_systemd_does_not_take_is_sent_again_until_it_does(systemd, supervision):
    systemd.is_full = True
    for _ in range(2):
        supervision.report(READY)
    systemd.is_full = False
    for _ in range(2):
        supervision.report(READY)

    assert systemd.sent == [("READY=1", f"STATUS={status_text(READY)}")] * 3
    assert len(systemd.written) == 1


@pytest.mark.parametrize(
    ("mode", "verdict", "priority", "fields"),
    [
        (Mode.READY, Verdict(), NOTICE, {}),
        (Mode.STOPPING, Verdict(cause=Cause.SHUTDOWN), NOTICE, {"GAITD_CAUSE": "shutdown"}),
        (Mode.STOPPING, STOPPED, ERROR, {"GAITD_CAUSE": "stop_requested"}),
        (
            *(Mode.FAULT, SILENT, ERROR),
            {"GAITD_CAUSE": "drive_silent", "GAITD_DRIVE": "right/hip"},
        ),
        (
            *(Mode.OFF, SILENT, WARNING),
            {"GAITD_CAUSE": "drive_silent", "GAITD_DRIVE": "right/hip"},
        ),
    ],
)
def test_the_journal_has_mode_cause_and_drive_as_fields(
    systemd, supervision, mode, verdict, priority, fields
):
    now = replace(record(7), mode=mode, verdict=verdict)

    supervision.report(now)

    assert systemd.written == [
        (
            *(status_text(now), priority),
            {"GAITD_EVENT": "mode", "GAITD_MODE": mode, "GAITD_CYCLE": "7", **fields},
        )
    ]


def ended(systemd, supervision, code=ExitCode.DONE, *, states=(), **changes):
    """What is said of a core that ends: of its drives with these states, `None`: unknown."""
    core = fresh().core
    core.drives = object()
    for axis, state in zip(core.axes, states, strict=False):
        show(axis, feedback=state and FEEDBACK._replace(power_state=state))
    for name, value in changes.items():
        setattr(core, name, value)
    supervision.end(core, code)
    return core, systemd.sent[-1][0].removeprefix("STATUS=")


UNPOWERED, POWERED = PowerState.SWITCH_ON_DISABLED, PowerState.OPERATION_ENABLED
BUG = (
    "ended by a bug of ours: quick stops were sent, and the drives stop by themselves; "
    "last seen: right/hip unknown, right/slide operation_enabled"
)


@pytest.mark.parametrize(
    ("code", "states", "changes", "text"),
    [
        (ExitCode.UNAVAILABLE, (None, POWERED), {}, BUG),
        (ExitCode.DRIVE, (), {}, "ended: the drives were refused and nothing was enabled"),
        (
            *(ExitCode.DONE, (), {"drives": None}),
            "ended without the drives: their power is not known",
        ),
        (
            *(ExitCode.DONE, (), {"drives": None, "verdict": Verdict(cause=Cause.BUS_DOWN)}),
            f"ended without the drives: their power is not known "
            f"({verdict_text(Verdict(cause=Cause.BUS_DOWN))})",
        ),
        (
            *(ExitCode.DONE, (), {"drives": None, "verdict": Verdict(cause=Cause.DRIVE_POWERED)}),
            f"ended without the drives: their power was not touched "
            f"({verdict_text(Verdict(cause=Cause.DRIVE_POWERED))})",
        ),
        (
            *(ExitCode.DONE, (UNPOWERED, None), {"verdict": STOPPED}),
            "ended, but not every drive showed that it is without power: "
            f"right/hip switch_on_disabled, right/slide unknown ({verdict_text(STOPPED)})",
        ),
        (
            *(ExitCode.DONE, (POWERED, UNPOWERED), {}),
            "ended, but not every drive showed that it is without power: "
            "right/hip operation_enabled, right/slide switch_on_disabled",
        ),
        (
            *(ExitCode.DONE, (UNPOWERED, UNPOWERED), {}),
            "ended: all axes are at rest and without power, no axis has a brake. the leg sinks",
        ),
    ],
)
def test_the_last_status_says_what_became_of_the_drives(
    systemd, supervision, code, states, changes, text
):
    _, said = ended(systemd, supervision, code, states=states, **changes)

    assert said == one_line(text)
    assert systemd.sent == [("STOPPING=1",), (f"STATUS={said}",)]
    priority = NOTICE if code is ExitCode.DONE else ERROR
    fields = {"GAITD_EVENT": "ended", "GAITD_EXIT_CODE": str(int(code))}
    assert systemd.written == [(said, priority, fields)]


def test_axes_with_a_brake_and_drives_in_silence_are_named_at_the_end(systemd, supervision):
    supervision.begin_end()
    core, _ = ended(systemd, supervision, states=(UNPOWERED, UNPOWERED))
    for axis in core.axes:
        axis.limits = axis.limits._replace(brake=True)
    assert "right/hip and right/slide on the brake. the leg" in final_state_text(
        core, ExitCode.DONE, "the leg sinks"
    )
    core.axes[0].stop = SimpleNamespace(step=Step.SILENCE)

    assert "not every drive" in final_state_text(core, ExitCode.DONE, "")
    assert systemd.sent.count(("STOPPING=1",)) == 1
