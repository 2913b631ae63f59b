"""6041h as the bus sees it: the present statusword, or a periodically updated copy.

Some drives update it in a task of their own every few milliseconds: until then SDO and PDO read
the previous value.
"""

from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.objects import Object


class Statusword:
    """One drive's object 6041h; with `period_ns` = 0 it is always the present statusword."""

    def __init__(self, context: NodeContext, period_ns: int) -> None:
        self._dictionary, self._line, self._timers = context
        self._period_ns = period_ns
        self._word = 0

    def set(self, word: int) -> None:
        """Set the present statusword."""
        self._word = word
        if not self._period_ns:
            self._dictionary.put(Object.STATUSWORD, 0, word)
        elif word != self._dictionary.value(Object.STATUSWORD):
            elapsed_ns = self._line.now_ns % self._period_ns
            at_ns = self._line.now_ns - elapsed_ns + self._period_ns
            if not self._timers.running(Statusword):
                self._timers.start(Statusword, at_ns, self._renew)

    def _renew(self) -> None:
        self._dictionary.put(Object.STATUSWORD, 0, self._word)
