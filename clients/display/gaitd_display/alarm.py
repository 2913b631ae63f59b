"""An alarm of a page: one identifier for each, so that a page acknowledges it once."""


class Alarm:
    """Counts the alarms of one server."""

    def __init__(self, run_id: str) -> None:
        """Start without an alarm.

        Args:
            run_id: differs with each start of the server, so that an alarm is never one of before.
        """
        self._run_id, self._count = run_id, 0
        self.about = ""
        """What it is about now; empty: none."""

    def take(self, about: str) -> str | None:
        """Take what an alarm is about, empty for none; return its identifier."""
        if about and about != self.about:
            self._count += 1
        self.about = about
        return f"{self._run_id}-{self._count}" if about else None
