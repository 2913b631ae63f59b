"""What a recording says of itself: its id, versions and hashes, and its modes, stops and losses."""

import secrets
from importlib.metadata import version
from typing import Annotated, Any, Final, Self

import msgspec
from gaitd_client import wire
from msgspec import Meta

NAME: Final = "gaitd"
"""Name of the metadata record at the begin of an MCAP file, and of the key in a Parquet file."""
END_NAME: Final = "gaitd.end"
CONFIGURATION: Final = "configuration.json"
"""Attachment of an MCAP file."""
UNITS: Final = (
    "SI; the unit of a number is the end of its name, that of a field with x-quantity in its schema"
    " is in joints; times are UTC in ns since 1970"
)
NONE: Final = "none"
INTEGER_MAX: Final = 2**63 - 1
"""What MCAP and Parquet can hold."""


Count = Annotated[int, Meta(ge=0, le=INTEGER_MAX)]


class Head(msgspec.Struct, frozen=True):
    """The fields that are read of every message; others are not looked at."""

    seq: Count
    core_boot_id: str | None
    cycle: Count | None
    sample_time_ns: Count | None
    mode: str | None = None


class About(msgspec.Struct, frozen=True, kw_only=True):
    """Known when a recording begins."""

    id: str
    """Random: names neither trainer nor patient."""
    trainer: str
    core_boot_id: str
    gaitd_version: str
    recorder_version: str
    period_ns: Annotated[int, Meta(gt=0)]
    leg_names: tuple[str, ...]
    drive_names: tuple[str, ...]
    joints: dict[str, wire.Joint]
    """Kind and units of each axis of a leg, by its name."""
    config_hashes: dict[str, str]
    robot: dict[str, Any]
    limits: dict[str, Any]
    begun_utc_ns: int
    units: str = UNITS

    @classmethod
    def of(cls, configuration: wire.Configuration, boot_id: str, begun_utc_ns: int) -> Self:
        """Make it of the service's configuration; addresses of clients are left out."""
        return cls(
            id=secrets.token_hex(8),
            trainer=configuration.trainer,
            core_boot_id=boot_id,
            gaitd_version=configuration.version or "",
            recorder_version=version("gaitd-record"),
            period_ns=configuration.period_ns or 10_000_000,
            leg_names=configuration.leg_names,
            drive_names=configuration.drive_names,
            joints=configuration.joints,
            config_hashes=configuration.config_hashes,
            robot=configuration.robot,
            limits=configuration.limits,
            begun_utc_ns=begun_utc_ns,
        )

    def configuration(self) -> bytes:
        """Return the attachment: robot and limits as the service had read them, as JSON."""
        return msgspec.json.encode({"robot": self.robot, "limits": self.limits})

    def metadata(self) -> dict[str, str]:
        """Return the rest as texts, as MCAP takes it; what is no text is JSON."""
        parts = msgspec.to_builtins(self)
        return {
            name: value if isinstance(value, str) else msgspec.json.encode(value).decode()
            for name, value in parts.items()
            if name not in {"robot", "limits"}
        }

    @classmethod
    def read(cls, metadata: dict[str, str], configuration: bytes) -> Self:
        """Read it back.

        Raises:
            ValueError: it is of another program or version.
        """
        texts = {one.name for one in msgspec.structs.fields(cls) if one.type is str}
        parts: dict[str, object] = {
            name: value if name in texts else msgspec.json.decode(value)
            for name, value in metadata.items()
        }
        parts |= msgspec.json.decode(configuration, type=dict[str, Any])
        return msgspec.convert(parts, cls)


class ModeChange(msgspec.Struct, frozen=True):
    """The mode of the service, from this time on."""

    utc_ns: int
    mode: str


class Stop(msgspec.Struct, frozen=True):
    """A verdict newly latched or replaced."""

    utc_ns: int
    category: str
    cause: str
    drive: str | None


class _Judged(msgspec.Struct, frozen=True):
    category: str
    cause: str
    drive: str | None


class _Safety(msgspec.Struct, frozen=True):
    sample_time_ns: Count | None
    mode: str | None
    verdict: _Judged | None


_SAFETY: Final = msgspec.json.Decoder(_Safety)


class Journal:
    """Modes, stops and losses, from the messages in their order."""

    def __init__(self) -> None:
        """Begin without a message."""
        self.modes: list[ModeChange] = []
        self.stops: list[Stop] = []
        self.lost: dict[str, int] = {}
        """Messages that were published and not received, by key."""
        self.end_utc_ns = 0
        self.message_count = 0
        self._seq: dict[str, int] = {}
        self._verdict = _Judged(NONE, NONE, None)

    def add(self, key: str, head: Head) -> None:
        """Count a message; `key` is below TRAINER."""
        gap = head.seq - self._seq.get(key, head.seq) - 1
        if gap > 0:  # a gateway that restarts counts from the beginning
            self.lost[key] = self.lost.get(key, 0) + gap
        self._seq[key] = head.seq
        self.message_count += 1
        self.end_utc_ns = max(self.end_utc_ns, head.sample_time_ns or 0)

    def add_safety(self, payload: bytes) -> None:
        """Take mode and verdict of a message `safety`."""
        safety = _SAFETY.decode(payload)
        if safety.mode is None or safety.verdict is None or safety.sample_time_ns is None:
            return
        if not self.modes or self.modes[-1].mode != safety.mode:
            self.modes.append(ModeChange(safety.sample_time_ns, safety.mode))
        if safety.verdict != self._verdict:
            self._verdict = judged = safety.verdict
            if judged.category != NONE:
                self.stops.append(
                    Stop(safety.sample_time_ns, judged.category, judged.cause, judged.drive)
                )

    def metadata(self, ended: str) -> dict[str, str]:
        """Return all of it as texts, as MCAP takes it.

        Args:
            ended: `in order`, or why not.
        """
        return {
            "ended": ended,
            "end_utc_ns": str(self.end_utc_ns),
            "message_count": str(self.message_count),
            "modes": msgspec.json.encode(self.modes).decode(),
            "stops": msgspec.json.encode(self.stops).decode(),
            "lost": msgspec.json.encode(self.lost).decode(),
        }
