"""What is kept across restarts: where each axis was left, whose sign is proven, which stop latches.

Pure: `state_file.py` reads and writes the file. Rules:

1.  The pose is noted while nothing is driven: at rest, referenced, with a sample of this cycle. So
    what is stored is the last orderly stop, and where the leg was moved to by hand afterwards.
2.  An absolute encoder is believed if it agrees with that pose, within the tolerance of the
    trainer file. Without a stored pose the trainer file says whether it is believed.
3.  A file that cannot be read is no file that is missing: nothing is believed then.
4.  A proof of a sign is of one drive and one transmission: another serial number, node, gear or
    sign makes it void.
5.  A stop that was latched when the core ended is latched in the next one (`latching.py`), and so
    is "nobody knows" where the file cannot be read.
"""

from typing import Final, NamedTuple

import msgspec
from msgspec.structs import replace

from daemon.ipc.decoding import Count

FORMAT: Final = "gaitd.axes.v1"
POSE_STEP_SI: Final = 1e-4
"""Encoder noise is not worth a new note."""


class Wiring(NamedTuple):
    """What the proof of an axis's sign is about."""

    node_id: int
    sign: int
    gear_ratio: float
    lead_m: float | None
    counts_per_rev: int


class SignProof(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Somebody saw this axis move the way it should, and so did its encoder."""

    node_id: Count
    serial_number: Count
    sign: int
    gear_ratio: float
    lead_m: float | None
    counts_per_rev: Count
    moved_forth_si: float
    moved_back_si: float
    utc_ns: Count


class AxisNote(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One axis; SI units at the joint."""

    position_si: float | None = None
    noted_utc_ns: Count = 0
    proof: SignProof | None = None


class InputsNote(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When the inputs of one drive were last seen in each state, UTC; 0: never."""

    hand_switch_open_utc_ns: Count = 0
    hand_switch_closed_utc_ns: Count = 0
    sto_active_utc_ns: Count = 0
    sto_released_utc_ns: Count = 0
    serial_number: Count = 0
    """Of the drive; 0: it has none."""


class AxisTestNote(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a self-test found of one axis; SI units at the joint."""

    friction_si: float
    friction_ratio: float
    load_error_si: float
    moved_si: float
    serial_number: Count = 0
    """Of the drive; 0: it has none."""


class SelfTestNote(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The newest self-test, of the whole machine."""

    utc_ns: Count
    passed: bool
    leg_digest: str
    axes: dict[str, AxisTestNote] = {}


class LatchedNote(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A verdict that only a reset takes away; category and cause by name."""

    category: str
    cause: str
    drive: str = ""
    value: float | None = None
    """None: none, or not finite."""
    limit: float | None = None
    detail: str = ""
    utc_ns: Count = 0
    """When it was noted first."""


class Notes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All axes by name."""

    axes: dict[str, AxisNote] = {}
    format: str = FORMAT
    damaged: bool = False
    """The file was there once and could not be read: what it does not hold is lost, not new."""
    latched: LatchedNote | None = None
    inputs: dict[str, InputsNote] = {}
    self_test: SelfTestNote | None = None
    utc_newest_ns: Count = 0
    """A time that has been: whoever reads an earlier one has a clock that went back."""

    def of(self, name: str) -> AxisNote:
        """What is noted of an axis."""
        return self.axes.get(name, AxisNote())

    def noted(self, name: str, note: AxisNote) -> "Notes":
        """The same with another note of one axis."""
        return replace(self, axes={**self.axes, name: note})


UNREADABLE: Final = Notes(
    damaged=True,
    latched=LatchedNote("S1", "LAST_END_UNKNOWN", detail="the notes of that run cannot be read"),
)
"""Notes of which nothing is known, not even whether a stop was latched."""


class PoseRules(NamedTuple):
    """[reference] of the trainer file, for one axis."""

    tolerance_si: float
    believed_without_pose: bool


def disagreement(notes: Notes, name: str, position_si: float, rules: PoseRules) -> str:
    """Why an absolute encoder is not believed; empty if it is (rules 2 and 3)."""
    stored_si = notes.of(name).position_si
    if stored_si is None and notes.damaged:
        return "the stored pose cannot be read"
    if stored_si is None:
        return "" if rules.believed_without_pose else "no pose has been stored yet"
    if abs(position_si - stored_si) <= rules.tolerance_si:
        return ""
    return f"its encoder says {position_si:.4g}, it was left at {stored_si:.4g}"


def proven(notes: Notes, name: str, wiring: Wiring, serial_number: int) -> bool:
    """Whether the sign of this axis, as it is wired and described now, has been proven (rule 4)."""
    proof = notes.of(name).proof
    if proof is None:
        return False
    now = (*wiring, serial_number)
    return now == (
        proof.node_id,
        proof.sign,
        proof.gear_ratio,
        proof.lead_m,
        proof.counts_per_rev,
        proof.serial_number,
    )


def prove(
    wiring: Wiring, serial_number: int, moved_si: tuple[float, float], utc_ns: int
) -> SignProof:
    """The proof of an axis that has moved forth and back as it was pushed."""
    return SignProof(
        **wiring._asdict(),
        serial_number=serial_number,
        moved_forth_si=moved_si[0],
        moved_back_si=moved_si[1],
        utc_ns=utc_ns,
    )


def with_pose(notes: Notes, name: str, position_si: float, utc_ns: int) -> Notes:
    """The notes with an axis where it rests now; the same ones if it has not moved."""
    note = notes.of(name)
    stored_si = note.position_si
    if stored_si is not None and abs(stored_si - position_si) <= POSE_STEP_SI:
        return notes
    return notes.noted(name, replace(note, position_si=position_si, noted_utc_ns=utc_ns))


def with_proof(notes: Notes, name: str, proof: SignProof) -> Notes:
    """The notes with the proof of an axis's sign."""
    return notes.noted(name, replace(notes.of(name), proof=proof))
