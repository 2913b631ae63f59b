"""Errors of one drive: EMCY frames, 1001h, 1003h and 603Fh (CiA 301 7.2.7, 7.5.2).

Rules:
1. An error that begins sends one EMCY with its code, enters 1003h as the newest, sets 603Fh and its
   class's bit in 1001h. The same code again while it is active sends nothing.
2. An error has a cause that is present or gone. One that stopped the drive ("latched") ends with a
   fault reset, which is refused while any latched cause is present. One that did not stop it
   (short PDO, lost connection on some drives) ends when its cause is gone.
3. Each ending sends EMCY 0000h with the remaining bits of 1001h; 603Fh is then the newest error
   left.
4. 1003h:0 may be written with 0 only, which empties the list: others 06090030. Reading an entry
   that does not exist is 08000024.
5. 1014h: bits 11 to 30 are 0, the identifier is not restricted, and it does not change while EMCY
   is valid: 06090030.
6. Two EMCY of a node are at least 1015h (in 100 µs) apart; later ones wait.
"""

from dataclasses import dataclass
from typing import Final

from drives.canopen.frame import Frame
from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.cob_id import EXTENDED_BITS, FLAG_30, INVALID, can_id_of, is_restricted
from sim_drives.canopen.dictionary import ObjectDictionary
from sim_drives.canopen.line import Line
from sim_drives.canopen.objects import Object

NO_ERROR: Final = 0x0000
_INHIBIT_STEP_NS: Final = 100_000

GENERIC_BIT: Final = 0x01
REGISTER_BITS: Final = (
    # mask, value of the code's class, bit of 1001h: the first match applies
    (0xF000, 0x2000, 0x02),  # current
    (0xF000, 0x3000, 0x04),  # voltage
    (0xF000, 0x4000, 0x08),  # temperature
    (0xFF00, 0x8100, 0x10),  # communication
    (0xFF00, 0x8200, 0x10),
    (0xF000, 0x8000, 0x20),  # device profile
    (0xFF00, 0xFF00, 0x80),  # manufacturer
    (0x0000, 0x0000, GENERIC_BIT),
)


def register_bit(code: int) -> int:
    """Return the bit of 1001h that the class of an error code sets."""
    return next(bit for mask, value, bit in REGISTER_BITS if code & mask == value)


@dataclass(slots=True)
class _Active:
    latched: bool
    present: bool = True


class Errors:
    """The active errors of one drive."""

    def __init__(self, dictionary: ObjectDictionary, line: Line, *, generic_bit: bool) -> None:
        self._dictionary = dictionary
        self._line = line
        self._generic_bit = generic_bit
        self._active: dict[int, _Active] = {}
        self._free_at_ns = 0
        self._history_max = dictionary.subindices(Object.ERROR_HISTORY)[-1]
        dictionary.guard(Object.ERROR_HISTORY, self._check_history)
        dictionary.guard_reading(Object.ERROR_HISTORY, self._check_reading)
        dictionary.guard(Object.EMCY_COB_ID, self._check_cob_id)
        dictionary.watch(Object.ERROR_HISTORY, lambda _: self._empty_history())

    @property
    def warning(self) -> bool:
        """True while an error is active that did not stop the drive."""
        return bool(self._active) and not all(one.latched for one in self._active.values())

    @property
    def can_id(self) -> int | None:
        """CAN identifier of the EMCY; None if 1014h disables it."""
        cob_id = self._dictionary.value(Object.EMCY_COB_ID)
        return None if cob_id & INVALID else can_id_of(cob_id)

    def active(self, code: int) -> bool:
        """Return whether this error is active."""
        return code in self._active

    def begin(self, code: int, *, latched: bool) -> None:
        """Begin an error (rule 1); a latched one also latches an active one of the same code."""
        known = self._active.get(code)
        if known is not None:
            known.present = True
            known.latched |= latched
            return
        self._active[code] = _Active(latched)
        self._store(code)
        self._update_objects()
        self._send(code)

    def repeat(self, code: int) -> None:
        """Send the active errors again, if the first EMCY could not reach the bus."""
        if code in self._active:
            self._send(code)

    def cause_gone(self, code: int) -> None:
        """Report that an error's cause is gone (rule 2); a code that is not active is ignored."""
        error = self._active.get(code)
        if error is None:
            return
        error.present = False
        if not error.latched:
            self._end({code})

    def set_warning(self, code: int, present: bool) -> None:
        """Begin an error that does not stop the drive, or end its cause."""
        if present:
            self.begin(code, latched=False)
        else:
            self.cause_gone(code)

    def reset(self) -> bool:
        """Reset faults: end all latched errors or none; return whether the reset was granted."""
        latched = {code: error for code, error in self._active.items() if error.latched}
        if any(error.present for error in latched.values()):
            return False
        if latched:
            self._end(set(latched))
        return True

    def reset_all(self) -> None:
        """Clear everything at power-on: no active error, no EMCY pending, 1003h empty."""
        self._active.clear()
        self._free_at_ns = 0
        self._empty_history()
        self._update_objects()

    def _end(self, codes: set[int]) -> None:
        for code in codes:
            del self._active[code]
        self._update_objects()
        self._send(NO_ERROR)

    def _update_objects(self) -> None:
        register = 0
        for code in self._active:
            register |= register_bit(code) | (GENERIC_BIT if self._generic_bit else 0)
        newest = next(reversed(self._active), NO_ERROR)
        self._dictionary.put(Object.ERROR_REGISTER, 0, register)
        self._dictionary.put(Object.ERROR_CODE, 0, newest)

    def _send(self, code: int) -> None:
        if self.can_id is None:
            return
        register = self._dictionary.value(Object.ERROR_REGISTER)
        data = code.to_bytes(2, "little") + bytes((register,)) + bytes(5)
        at_ns = max(self._line.now_ns, self._free_at_ns)
        inhibit_steps = self._dictionary.value_or(Object.EMCY_INHIBIT_TIME, 0, 0)
        self._free_at_ns = at_ns + inhibit_steps * _INHIBIT_STEP_NS
        self._line.send(Frame(self.can_id, data), delay_ns=at_ns - self._line.now_ns)

    def _store(self, code: int) -> None:
        count = min(self._dictionary.value(Object.ERROR_HISTORY, 0) + 1, self._history_max)
        for slot in range(count, 1, -1):
            older = self._dictionary.value(Object.ERROR_HISTORY, slot - 1)
            self._dictionary.put(Object.ERROR_HISTORY, slot, older)
        self._dictionary.put(Object.ERROR_HISTORY, 1, code)
        self._dictionary.put(Object.ERROR_HISTORY, 0, count)

    def _empty_history(self) -> None:
        for slot in range(self._history_max + 1):
            self._dictionary.put(Object.ERROR_HISTORY, slot, 0)

    def _check_history(self, subindex: int, value: int) -> None:
        if subindex == 0 and value != 0:
            raise SdoAbortError(AbortCode.RANGE)

    def _check_reading(self, subindex: int) -> None:
        if subindex > self._dictionary.value(Object.ERROR_HISTORY, 0):
            raise SdoAbortError(AbortCode.NO_DATA)

    def _check_cob_id(self, _: int, value: int) -> None:
        now = self._dictionary.value(Object.EMCY_COB_ID)
        moves = not now & INVALID and can_id_of(value) != can_id_of(now)
        if moves or value & (EXTENDED_BITS | FLAG_30) or is_restricted(can_id_of(value)):
            raise SdoAbortError(AbortCode.RANGE)
