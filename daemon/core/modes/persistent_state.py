"""Persistent state: last pose of each axis, proven signs, daily test, and a latched stop.

Pure: `state_file.py` reads and writes the file. Rules:

1.  The pose is stored while no drive is enabled: at rest, followed, with a sample of this cycle.
    The stored pose is that of the last orderly stop, or where the leg was moved by hand afterwards.
2.  An absolute encoder is accepted if it agrees with that pose, within the tolerance of the
    trainer file. Without a stored pose a setting of the trainer file decides.
3.  An unreadable file is not treated as a missing file: no encoder is accepted then.
4.  A proof of a sign is valid for one drive and one transmission: another serial number, node,
    gear or sign makes it void. A drive without a serial number cannot be told from another one:
    proof and daily test of it end as soon as it is not watched, and with the core.
    A reboot, a silence or doubtful feedback of the drive puts it in doubt until the next sign test
    or self-test: it permits enabling still, but no motion against the drive is a person's by it.
5.  A stop that was latched when the core ended is latched in the next one (`latched_stop.py`). If
    the file cannot be read, LAST_END_UNKNOWN is latched.
"""

from typing import Final, NamedTuple

import msgspec
from gaitd_names import Cause, Doubt, Finding, StopCategory
from msgspec.structs import replace

from daemon.ipc.decoding import Count

FORMAT: Final = "gaitd.axes.v1"
POSE_STEP_SI: Final = 1e-4
"""Smallest change of a stored pose, rad or m; smaller ones are encoder noise."""


class Wiring(NamedTuple):
    """The drive settings of an axis for which a sign proof is valid."""

    node_id: int
    sign: int
    gear_ratio: float
    lead_m: float | None
    counts_per_rev: int


class SignProof(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Proof of an axis's sign: encoder and operator have confirmed the direction of motion."""

    node_id: Count
    serial_number: Count
    sign: int
    gear_ratio: float
    lead_m: float | None
    counts_per_rev: Count
    moved_forth_si: float
    moved_back_si: float
    utc_ns: Count
    doubted: bool = False
    """Since the newest test its drive has rebooted or was silent, or its feedback was doubtful."""


class StoredAxis(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Persistent state of one axis; SI units at the joint."""

    position_si: float | None = None
    noted_utc_ns: Count = 0
    proof: SignProof | None = None


class StoredInputs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Times at which the inputs of one drive were last seen in each state, UTC; 0: never."""

    hand_switch_open_utc_ns: Count = 0
    hand_switch_closed_utc_ns: Count = 0
    sto_active_utc_ns: Count = 0
    sto_released_utc_ns: Count = 0
    serial_number: Count = 0
    """Serial number of the drive; 0: it has none."""


class StoredAxisTest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Findings of a self-test for one axis; SI units at the joint."""

    friction_si: float
    friction_ratio: float
    load_error_si: float
    moved_si: float
    serial_number: Count = 0
    """Serial number of the drive; 0: it has none."""


class StoredSelfTest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Result of the newest self-test of the whole machine."""

    utc_ns: Count
    passed: bool
    leg_digest: str
    axes: dict[str, StoredAxisTest] = {}


class StoredVerdict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A verdict that only a reset removes; category, cause and finding by name."""

    category: str
    cause: str
    drive: str = ""
    value: float | None = None
    """None: there is no value, or it is not finite."""
    limit: float | None = None
    finding: str = Finding.NONE
    said: str = ""
    utc_ns: Count = 0
    """Time at which the verdict was first stored."""


class PersistentState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole persistent state, as stored in the state file; axes by name."""

    axes: dict[str, StoredAxis] = {}
    format: str = FORMAT
    damaged: bool = False
    """The file existed and could not be read: missing entries are lost, not new."""
    latched: StoredVerdict | None = None
    inputs: dict[str, StoredInputs] = {}
    self_test: StoredSelfTest | None = None
    utc_newest_ns: Count = 0
    """Latest UTC time read: a clock that shows an earlier time was set back."""

    def axis(self, name: str) -> StoredAxis:
        """The stored state of one axis; an empty note if there is none."""
        return self.axes.get(name, StoredAxis())

    def with_axis(self, name: str, stored: StoredAxis) -> "PersistentState":
        """A copy with another note for one axis."""
        return replace(self, axes={**self.axes, name: stored})


UNREADABLE: Final = PersistentState(
    damaged=True,
    latched=StoredVerdict(
        StopCategory.S1, Cause.LAST_END_UNKNOWN, finding=Finding.NOTES_UNREADABLE
    ),
)
"""State after an unreadable file: a stop may have been latched, so LAST_END_UNKNOWN is."""
TORN: Final = StoredVerdict(StopCategory.S1, Cause.LAST_END_UNKNOWN, finding=Finding.NOTES_TORN)
"""Latched beside a torn page of the file, if the page before has no stop."""


class PoseRules(NamedTuple):
    """Settings of [reference] in the trainer file, for one axis."""

    tolerance_si: float
    believed_without_pose: bool


def disagreement(
    persistent: PersistentState, name: str, position_si: float, rules: PoseRules
) -> Doubt:
    """The reason why an absolute encoder is not accepted; NONE if it is (rules 2 and 3)."""
    stored_si = persistent.axis(name).position_si
    if stored_si is None and persistent.damaged:
        return Doubt.POSE_UNREADABLE
    if stored_si is None:
        return Doubt.NONE if rules.believed_without_pose else Doubt.NO_POSE_STORED
    if abs(position_si - stored_si) <= rules.tolerance_si:
        return Doubt.NONE
    return Doubt.LEFT_ELSEWHERE


def proven(persistent: PersistentState, name: str, wiring: Wiring, serial_number: int) -> bool:
    """True if the sign of this axis is proven for its present drive and wiring (rule 4)."""
    proof = persistent.axis(name).proof
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


def trusted(persistent: PersistentState, name: str, wiring: Wiring, serial_number: int) -> bool:
    """True if the sign is proven for a drive with a serial number, and not in doubt (rule 4)."""
    proof = persistent.axis(name).proof
    in_doubt = proof is None or proof.doubted or serial_number == 0
    return not in_doubt and proven(persistent, name, wiring, serial_number)


def with_doubt(persistent: PersistentState, name: str, *, doubted: bool) -> PersistentState:
    """A copy with the proof of an axis put in doubt, or free of it; the same object if it was."""
    proof = persistent.axis(name).proof
    if proof is None or proof.doubted == doubted:
        return persistent
    return with_proof(persistent, name, replace(proof, doubted=doubted))


def prove(
    wiring: Wiring, serial_number: int, moved_si: tuple[float, float], utc_ns: int
) -> SignProof:
    """The sign proof of an axis that moved forth and back in the direction of its torque."""
    return SignProof(
        **wiring._asdict(),
        serial_number=serial_number,
        moved_forth_si=moved_si[0],
        moved_back_si=moved_si[1],
        utc_ns=utc_ns,
    )


def without_tests(persistent: PersistentState, name: str) -> PersistentState:
    """A copy without proof and daily test of one axis; the same object if there are none."""
    stored, tested = persistent.axis(name), persistent.self_test
    if tested is not None and name in tested.axes:
        persistent = replace(persistent, self_test=None)
    if name in persistent.inputs:
        rest = {axis: one for axis, one in persistent.inputs.items() if axis != name}
        persistent = replace(persistent, inputs=rest)
    if stored.proof is not None:
        persistent = persistent.with_axis(name, replace(stored, proof=None))
    return persistent


def with_pose(
    persistent: PersistentState, name: str, position_si: float, utc_ns: int
) -> PersistentState:
    """A copy with the present pose of an axis; the same object if the axis has not moved."""
    stored = persistent.axis(name)
    stored_si = stored.position_si
    if stored_si is not None and abs(stored_si - position_si) <= POSE_STEP_SI:
        return persistent
    return persistent.with_axis(name, replace(stored, position_si=position_si, noted_utc_ns=utc_ns))


def with_proof(persistent: PersistentState, name: str, proof: SignProof) -> PersistentState:
    """A copy with the proof of an axis's sign."""
    return persistent.with_axis(name, replace(persistent.axis(name), proof=proof))
