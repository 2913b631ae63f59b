"""Table of the limits that the drives themselves hold: object, value, and configuration key.

`rows` derives them from the steps of bring-up, so the table cannot differ from what is done. Each
step that writes is either a row here or belongs to communication and mapping (COMMUNICATION), which
`tests/drive_backstop/test_table.py` checks; `page` is docs/backstop.md.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from analysis import markdown
from daemon.config.bundle import Settings
from daemon.config.drive_plan import cycle_settings, drive_limits
from drives.bringup.plan import plan
from drives.bringup.steps import Step, StepKind
from drives.canopen.objects import Object
from drives.cia402.profile import DriveDescription
from drives.cia402.torque import ObjectRef


class Source(NamedTuple):
    """The quantity that an object bounds, and the configuration key of its value."""

    bounds: str
    key: str


@dataclass(frozen=True, order=True, slots=True)
class Row:
    """One object of one drive."""

    index: int
    sub: int
    value: int
    """The value as it is written and read back."""
    bounds: str
    key: str

    @property
    def place(self) -> str:
        """Index and subindex, for example `6065h:00`."""
        return f"{self.index:04X}h:{self.sub:02X}"


WRITES: Final = frozenset({StepKind.WRITE, StepKind.CLEAR, StepKind.RANGE})
COMMUNICATION: Final = frozenset(
    {
        Object.SYNC_WINDOW,
        Object.HEARTBEAT_PRODUCER,
        Object.SYNC_COUNTER,
        *range(Object.RPDO, 0x1A10),
        Object.MODE,
        Object.TARGET_TORQUE,
        Object.TARGET_POSITION,
    }
)
"""Objects of PDOs, SYNC, heartbeats and initial targets: no limits, except 1400h:05."""
RPDO_TIMEOUT_SUB: Final = 5
_POSITION: Final = Source(
    "software position limits", "[hip] position_min_deg, _max_deg; [slide] position_min_m, _max_m"
)
_TORQUE: Final = Source("torque", "[hip] torque_max_nm; [slide] force_max_n")
_PROFILE: Final = "the profile"
_CLEARED: Final = "cleared where the drive has it"
SOURCES: Final[Mapping[int, Source]] = {
    Object.HEARTBEAT_CONSUMER: Source(
        "loss of the master's heartbeat, in ms (low word)", "[cycle] drive_detection_ms"
    ),
    Object.ERROR_BEHAVIOUR: Source("the drive's NMT state after that loss", _PROFILE),
    Object.ABORT_CONNECTION: Source("reaction to that loss", _PROFILE),
    Object.QUICK_STOP: Source("reaction to a quick stop", _PROFILE),
    Object.SHUTDOWN: Source("reaction to a shutdown", _PROFILE),
    Object.DISABLE: Source("reaction to disabling the operation", _PROFILE),
    Object.HALT: Source("reaction to a halt", _PROFILE),
    Object.FAULT_REACTION: Source("reaction to a fault", _PROFILE),
    Object.FOLLOWING_WINDOW: Source(
        "following error", "[hip] following_error_deg; [slide] following_error_m"
    ),
    Object.FOLLOWING_TIME: Source("permitted duration of the following error, in ms", _PROFILE),
    Object.POSITION_LIMITS: _POSITION,
    Object.SPEED_LIMIT: Source(
        "speed", "[hip] velocity_max_rad_per_s; [slide] velocity_max_m_per_s"
    ),
    Object.QUICK_STOP_DECELERATION: Source(
        "the ramp of a quick stop",
        "[hip] quick_stop_deceleration_rad_per_s2; [slide] quick_stop_deceleration_m_per_s2",
    ),
    Object.POSITION_OFFSET: Source("no position offset", _CLEARED),
    Object.VELOCITY_OFFSET: Source("no velocity offset", _CLEARED),
    Object.TORQUE_OFFSET: Source("no torque offset", _CLEARED),
    Object.INTERPOLATION_TIME: Source(
        "interpolation time of the target position", "[cycle] period_ms"
    ),
}
"""Sources by index; the index of the torque limit is in the profile."""
_RPDO_TIMEOUT: Final = Source("loss of the commands, in ms", "[cycle] rpdo_timeout_ms")


def rows(settings: Settings, drive: DriveDescription, axis: int) -> tuple[Row, ...]:
    """All limits of one drive, in the order of their indices.

    Args:
        settings: the configuration.
        drive: one of its drives.
        axis: 0 hip, 1 slide.
    """
    steps = plan(
        drive, drive_limits(settings.limits)[axis], cycle_settings(settings.trainer.cycle)
    ).steps
    found = [row for step in steps for row in _rows(step, drive.profile.torque_limit)]
    return tuple(sorted(found))


def source_of(step: Step, torque_limit: ObjectRef) -> Source | None:
    """The source of the value that a step writes; None where it is no limit."""
    if step.kind not in WRITES:
        return None
    if (step.index, step.sub) == (torque_limit.index, torque_limit.sub):
        return _TORQUE
    if Object.RPDO <= step.index < Object.RPDO_MAPPING and step.sub == RPDO_TIMEOUT_SUB:
        return _RPDO_TIMEOUT
    return SOURCES.get(step.index)


def _rows(step: Step, torque_limit: ObjectRef) -> Iterator[Row]:
    source = source_of(step, torque_limit)
    if source is None:
        return
    yield Row(step.index, step.sub, step.value, *source)
    if step.kind is StepKind.RANGE:
        yield Row(step.index, step.sub + 1, step.second, *source)


def page(makes: Mapping[str, Settings]) -> str:
    """The text of docs/backstop.md: for each make the limits of both drives."""
    parts: list[str] = []
    for make, settings in makes.items():
        leg = settings.legs[0]
        hip, slide = rows(settings, leg.hip, 0), rows(settings, leg.slide, 1)
        parts += [f"## {make}", _lacks(leg.hip), _table(hip, slide)]
    return markdown.page(_HEAD, *parts)


def _table(hip: tuple[Row, ...], slide: tuple[Row, ...]) -> str:
    lines = [
        (one.place, one.bounds, _value_text(one), _value_text(other), one.key)
        for one, other in zip(hip, slide, strict=True)
    ]
    return markdown.table(("object", "bounds", "hip", "slide", "from"), lines)


def _value_text(row: Row) -> str:
    return f"{row.value:08X}h" if row.index == Object.HEARTBEAT_CONSUMER else str(row.value)


def _lacks(drive: DriveDescription) -> str:
    """Limits that this make does not hold by itself, or that are not documented."""
    has, profile = drive.profile.optional_objects, drive.profile
    missing = [
        words
        for there, words in (
            (has.position_limits, "607Dh"),
            (has.speed_limit, "6080h"),
            (has.following_error, "6065h"),
            (profile.pdo.rpdo_timeout, "a timeout of RPDO1 (1400h:05)"),
        )
        if not there
    ]
    lines = [
        f"Not enforced: {', '.join(missing)}." if missing else "All limits below are enforced."
    ]
    for place, written, keeps in (
        ("6080h", has.speed_limit, profile.torque_mode.speed_limit),
        ("607Dh", has.position_limits, profile.torque_mode.position_limits),
    ):
        if written:
            lines.append(f"{place} in cyclic torque: {keeps.value.replace('_', ' ')}.")
    return " ".join(lines)


_HEAD: Final = """\
# The limits in the drives

These limits stop the leg when the core does not: it was killed, hangs, or sends wrong commands.
Bring-up writes each object below and reads it back; a drive that does not keep a value is refused.
The values are those of the shipped `limits.toml`, in the drive's own units. This page is written
from the steps of bring-up (`make golden`), and a test compares it.

| failure | limits that act without the core |
| --- | --- |
| the core is killed | 1016h (and 1400h:05), then 6007h and its ramp 6085h: both drives |
| no commands, but SYNC and heartbeat | 1400h:05 where a drive has it, or the limits |
| the last command is repeated without end | torque limit, 6080h, 607Dh |
| the commanded torque is above the limit | the torque limit |
| the target position is far from the position | 6065h with 6066h; the ramp of 605Eh |
| the target position is outside the range | 607Dh |

`tests/drive_backstop/test_rogue_master.py` tests each row with a faulty master and raw frames.

Each drive monitors only itself: a position limit or a following error stops that drive and not the
other one. Only the loss of the master's heartbeat stops both.

CiA 402 does not specify whether 6080h and 607Dh act in cyclic torque mode: Beckhoff's EP7412
limits its speed in cyclic position and velocity mode only, Lenze's i700 and Nanotec's PD4-E also in
cyclic torque mode. A profile states "kept", "not kept" or "unknown" (`[torque_mode]`), and
`gaitd check` warns. The virtual drives keep both. `max_runaway_deg` and `max_runaway_m` bound how
far a leg moves until the loss of the heartbeat has stopped it. Where 6007h ends in a fault (EPOS4)
the axis has no torque after its ramp: `gaitd check` prints how far a leg then drifts."""
