"""EMCY codes of a maker, as a drive profile lists them: `emergencies`.

No file makes a code milder than the standard: only a device-specific code, FFxxh, may be a mere
warning, and a sensor's code, 73xxh, always makes the encoder unreliable. A code without a reaction
counts as the worst.
"""

from typing import Annotated, Final, Literal

from msgspec import Meta

from drives.canopen.emcy_codes import DEVICE_CLASS, SENSOR_CLASS, CodeMeaning, Codes, Reaction
from drives.cia402.torque import Table
from drives.errors import DescriptionError

Code = Annotated[int, Meta(ge=0x0001, le=0xFFFF)]
CODES_MAX: Final = 1000
"""Codes of one range at most: a mistyped end would give a meaning to nearly all."""
TEXT_LENGTH_MAX: Final = 60
"""A record has a slot of fixed size."""
_REACTIONS: Final = {
    None: Reaction.UNKNOWN,
    "warning": Reaction.WARNING,
    "abort_connection": Reaction.ABORT_CONNECTION,
    "fault_reaction": Reaction.FAULT_REACTION,
    "switched_off": Reaction.SWITCHED_OFF,
}


class MakerCode(Table, frozen=True, kw_only=True):
    """One EMCY code of a maker, or some in a row with the same meaning."""

    code: Code
    """EMCY error code."""
    last_code: Code | None = None
    """The last one of a range."""
    text: Annotated[str, Meta(min_length=1, max_length=TEXT_LENGTH_MAX)]
    """What it means, from the manual."""
    reaction: Literal["warning", "abort_connection", "fault_reaction", "switched_off"] | None = None
    """What the drive does by itself: nothing, 6007h, 605Eh, or the power stage off at once."""
    loses_reference: bool = False
    """The encoder is no longer reliable: the axis must be referenced again."""

    @property
    def codes(self) -> range:
        """All codes of this entry."""
        return range(self.code, (self.code if self.last_code is None else self.last_code) + 1)


def codes_of(emergencies: tuple[MakerCode, ...]) -> Codes:
    """Return the meaning of each code of a maker."""
    return {
        code: CodeMeaning(
            entry.text,
            _REACTIONS[entry.reaction],
            entry.loses_reference or code >> 8 == SENSOR_CLASS,
        )
        for entry in emergencies
        for code in entry.codes
    }


def check_emergencies(emergencies: tuple[MakerCode, ...]) -> None:
    """Check the codes of a maker.

    Raises:
        DescriptionError: a range without an end, a code twice, or one that the file makes milder.
    """
    known: set[int] = set()
    for entry in emergencies:
        key = f"emergencies[{entry.code:04X}h]"
        if not 0 < len(entry.codes) <= CODES_MAX:
            allowed = f"from code on, {CODES_MAX} codes at most"
            raise DescriptionError("profile", f"{key}.last_code", entry.last_code, allowed)
        if known & {*entry.codes}:
            raise DescriptionError("profile", f"{key}.code", entry.code, "each code once")
        known |= {*entry.codes}
        if entry.reaction == "warning" and any(one >> 8 != DEVICE_CLASS for one in entry.codes):
            allowed = "a stop: only FFxxh, which CiA 301 leaves to the maker, may be a warning"
            raise DescriptionError("profile", f"{key}.reaction", entry.reaction, allowed)
