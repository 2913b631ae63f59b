"""Mode changes and the text of verdicts, used by supervisor and requests."""

from daemon.core.modes import table
from daemon.core.modes.table import Event
from daemon.core.state import Core
from daemon.ipc.record import Verdict
from daemon.wire.causes import CAUSE_TEXT


def enter(core: Core, event: Event) -> None:
    """Apply a row of the mode table and publish the change as an event.

    Raises:
        IllegalTransitionError: there is no such row: a programming error.
    """
    before = core.mode
    core.mode = table.next_mode(before, event)
    core.progress = ""
    core.events.append(f"mode {before.name.lower()} -> {core.mode.name.lower()}: {event.value}")


def describe(verdict: Verdict) -> str:
    """The text of a verdict: drive, cause, value and limit."""
    text = CAUSE_TEXT[verdict.cause]
    where = f"{verdict.drive}: " if verdict.drive else ""
    numbers = f" ({verdict.value:.4g}, limit {verdict.limit:.4g})" if verdict.limit else ""
    detail = f": {verdict.detail}" if verdict.detail else ""
    return f"{where}{text.title}{numbers}{detail}"
