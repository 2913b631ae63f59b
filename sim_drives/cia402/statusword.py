"""6041h as the bus sees it: the word of this instant, or a copy that is renewed now and then.

Some drives renew it by a task of their own every few milliseconds: until then SDO and PDO both read
the word before.
"""

from typing import Final

from sim_drives.canopen.dictionary import ObjectDictionary
from sim_drives.canopen.line import Line
from sim_drives.canopen.timers import Timers

STATUSWORD: Final = 0x6041


class Statusword:
    """One drive's object 6041h; with `period_ns` = 0 it is always that of this instant."""

    def __init__(
        self, dictionary: ObjectDictionary, line: Line, timers: Timers, period_ns: int
    ) -> None:
        self._dictionary = dictionary
        self._line = line
        self._timers = timers
        self._period_ns = period_ns
        self._word = 0

    def show(self, word: int) -> None:
        """The word is this from now on."""
        self._word = word
        if not self._period_ns:
            self._renew()
        elif word != self._dictionary.value(STATUSWORD) and not self._timers.running(STATUSWORD):
            elapsed_ns = self._line.now_ns % self._period_ns
            at_ns = self._line.now_ns - elapsed_ns + self._period_ns
            self._timers.start(STATUSWORD, at_ns, self._renew)

    def _renew(self) -> None:
        self._dictionary.put(STATUSWORD, 0, self._word)
