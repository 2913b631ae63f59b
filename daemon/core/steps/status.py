"""Stage, progress and verdict as they are published. Nothing here changes state."""

from daemon.core.state import Core
from daemon.core.steps import exercises
from daemon.ipc.record import Cause, Mode, Stage
from daemon.wire.report_texts import describe


def stage(core: Core) -> Stage | None:
    """The stage of the exercise; None without an exercise, and in STOPPING and FAULT."""
    if core.mode in {Mode.STOPPING, Mode.FAULT}:
        return None
    if core.mode == Mode.BRINGING_UP:
        return Stage.PREPARING
    if core.single_axis is not None:
        return core.single_axis.stage
    if core.mode == Mode.HOLD:
        return None if core.load_checked else Stage.PREPARING
    return exercises.stage(core)


def progress(core: Core) -> str:
    """One line of text for the operator about the present activity."""
    if core.mode in {Mode.OFF, Mode.FAULT} and core.verdict.cause != Cause.NONE:
        return describe(core.verdict)
    text = exercises.text(core) if core.mode.active else ""
    if text:
        return f"{core.mode.name.lower()}: {text}"
    if core.single_axis is not None:
        return f"{core.single_axis.axis}: {core.single_axis.step.value}"
    if core.mode == Mode.HOLD and not core.load_checked:
        return "enabling: the load at rest is being compared"
    return core.progress or core.mode.name.lower().replace("_", " ")
