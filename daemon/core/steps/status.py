"""Stage and progress as they are published. Nothing here changes state."""

from gaitd_names import Mode, ProgressCode, Stage

from daemon.core.state import Core
from daemon.core.steps import exercises
from daemon.ipc.report import Progress


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


def progress(core: Core) -> Progress | None:
    """What the machine does now; None: nothing beside its mode and stage."""
    if core.bring_up is not None:
        return core.bring_up
    if core.mode.active and (own := exercises.progress(core)) is not None:
        return own
    run = core.single_axis
    if run is not None:
        return Progress(ProgressCode.ONE_AXIS, run.axis, (run.step,))
    if core.mode == Mode.HOLD and not core.load_checked:
        return Progress(ProgressCode.COMPARING_LOAD)
    return None
