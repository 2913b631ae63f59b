"""Who saw what a fault did: the bus, the plant's truth and the ring. None of them is the service.

    with Watch(service) as seen:      everything is quiet, or walks
        seen.begin()                  here the fault happens
        ...
        seen.read_bus()

Times are simulated.
"""

import contextlib
import time
from typing import NamedTuple

import can
from processes import Service

from daemon.ipc.record import CycleRecord
from drives.signals import PowerState

SYNC, MASTER_HEARTBEAT = 0x080, 0x701
CONTROLWORDS = (0x205, 0x206)
ENABLE_BITS = 0x0F
"""Operation enabled and no quick stop (bit 2 is low active)."""
STATES = (
    (0x4F, 0x40, PowerState.SWITCH_ON_DISABLED),
    (0x6F, 0x21, PowerState.READY_TO_SWITCH_ON),
    (0x6F, 0x23, PowerState.SWITCHED_ON),
    (0x6F, 0x27, PowerState.OPERATION_ENABLED),
    (0x6F, 0x07, PowerState.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, PowerState.FAULT_REACTION_ACTIVE),
    (0x4F, 0x08, PowerState.FAULT),
)
"""CiA 402-2, statusword: mask, value."""
STANDSTILL = (0.05, 0.03)
"""rad/s and m/s, as limits.toml has it."""
SETTLE_NS = 100_000_000
SDO_READ_STATUSWORD = bytes((0x40, 0x41, 0x60, 0, 0, 0, 0, 0))


class Heard(NamedTuple):
    """A frame on the bus."""

    time_ns: int
    can_id: int
    data: bytes


class Moved(NamedTuple):
    """What one leg really did after a fault."""

    hip_deg: float
    """Farthest from where it was."""
    slide_mm: float
    rest_ms: float | None
    """From the fault until it stood and went on standing; None: it has not."""


class Watch:
    """The witnesses of one fault."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._ends = contextlib.ExitStack()
        self._bus: can.BusABC | None = None
        self._truth_offset = 0
        self._seq = 0
        self.begun_ns = 0
        self.frames: list[Heard] = []

    def __enter__(self) -> "Watch":
        self._bus = self._ends.enter_context(self._service.listener())
        self._truth_offset = self._service.truth_path.stat().st_size
        with contextlib.suppress(FileNotFoundError):
            self._seq = self._service.newest().seq
        self.begin()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def begin(self) -> None:
        """Now the fault happens."""
        self.begun_ns = self._service.clock.now_ns()

    # --- the bus ----------------------------------------------------------------------------

    def read_bus(self, quiet_s: float = 0.0) -> list[Heard]:
        """Everything that has come so far, with what came before."""
        offset_ns = self._service.clock.utc_ns() - self._service.clock.now_ns()
        while (message := self._listening.recv(quiet_s)) is not None:
            time_ns = int(message.timestamp * 1e9) - offset_ns
            self.frames.append(Heard(time_ns, message.arbitration_id, bytes(message.data)))
        return self.frames

    @property
    def _listening(self) -> can.BusABC:
        assert self._bus is not None
        return self._bus

    def since(self, *can_ids: int) -> list[Heard]:
        """Frames with these identifiers since the fault."""
        return [f for f in self.frames if f.can_id in can_ids and f.time_ns >= self.begun_ns]

    def emergencies(self) -> dict[int, list[Heard]]:
        """EMCY messages that are no all-clear since the fault, by node."""
        found: dict[int, list[Heard]] = {}
        for node in (5, 6):
            came = [f for f in self.since(0x080 + node) if f.data[:2] != b"\0\0"]
            if came:
                found[node] = came
        return found

    def emergency_codes(self) -> dict[int, int]:
        """The first EMCY code of each node since the fault."""
        return {
            node: int.from_bytes(came[0].data[:2], "little")
            for node, came in self.emergencies().items()
        }

    def alarm_ms(self) -> float:
        """From the fault to the later one of the drives' alarms."""
        alarms = [came[0].time_ns for came in self.emergencies().values()]
        return (max(alarms) - self.begun_ns) * 1e-6

    def enabling(self, since_ns: int) -> list[Heard]:
        """Controlwords since then that ask a drive to be, or to stay, enabled."""
        words = [f for f in self.frames if f.can_id in CONTROLWORDS and f.time_ns >= since_ns]
        return [f for f in words if f.data[0] & ENABLE_BITS == ENABLE_BITS]

    def ms_until_noticed(self, node: int, can_id: int) -> float:
        """From the last frame of what a drive watches to its alarm."""
        alarm_ns = self.emergencies()[node][0].time_ns
        watched = [f.time_ns for f in self.frames if f.can_id == can_id and f.time_ns < alarm_ns]
        return (alarm_ns - watched[-1]) * 1e-6

    def statuswords(self) -> dict[int, PowerState]:
        """What each drive says of itself to a stranger who reads its statusword over SDO."""
        words: dict[int, PowerState] = {}
        for node in (5, 6):
            read = can.Message(
                arbitration_id=0x600 + node, data=SDO_READ_STATUSWORD, is_extended_id=False
            )
            self._listening.send(read)
            end_s = time.monotonic() + 5
            while node not in words and time.monotonic() < end_s:
                message = self._listening.recv(0.1)
                answers = message is not None and message.arbitration_id == 0x580 + node
                if answers and message.data[1:4] == SDO_READ_STATUSWORD[1:4]:
                    word = int.from_bytes(message.data[4:6], "little")
                    words[node] = next(name for mask, value, name in STATES if word & mask == value)
        return words

    # --- the plant --------------------------------------------------------------------------

    def moved(self) -> Moved:
        """What the leg did since the fault, up to now."""
        rows = self._truth_rows()
        after = [row for row in rows if row[0] >= self.begun_ns]
        before = [row for row in rows if row[0] < self.begun_ns]
        start = before[-1] if before else after[0]
        hip = max(abs(row[1] - start[1]) for row in after)
        slide = max(abs(row[2] - start[2]) for row in after)
        moving = [row for row in after if _moves(row)]
        stood_ns = moving[-1][0] if moving else self.begun_ns
        stands = after[-1][0] - stood_ns > SETTLE_NS
        rest_ms = (stood_ns - self.begun_ns) * 1e-6 if stands else None
        return Moved(hip * 57.29578, slide * 1e3, rest_ms)

    def until_rest(self, within_s: float) -> Moved:
        """What the leg did until it stood; without power it may fall out of that pose again."""
        found: list[Moved] = []

        def stands() -> bool:
            found.append(self.moved())
            return found[-1].rest_ms is not None

        self._service.wait(stands, within_s)
        return found[-1]

    def _truth_rows(self) -> list[tuple[float, ...]]:
        """Time in ns, hip and slide: position, then velocity."""
        with self._service.truth_path.open() as file:
            columns = file.readline().strip().split(",")
            file.seek(max(self._truth_offset - 4096, 0))
            lines = file.read().split("\n")[1:-1]
        names = ("sync_mono_ns", "hip_angle_rad", "slide_position_m")
        names += ("hip_velocity_rad_per_s", "slide_velocity_m_per_s")
        places = [columns.index(name) for name in names]
        cells = (line.split(",") for line in lines if line.count(",") >= len(columns) - 1)
        return [tuple(float(row[place]) for place in places) for row in cells if row[0] != "time_s"]

    # --- the ring ---------------------------------------------------------------------------

    def records(self) -> list[CycleRecord]:
        """Records of the core that runs now or ran last, since shortly before the fault."""
        return self._service.records(max(self._seq - 5, 0))

    def records_since(self) -> list[CycleRecord]:
        """Records of cycles that began after the fault."""
        return [record for record in self.records() if record.sync_mono_ns >= self.begun_ns]


def _moves(row: tuple[float, ...]) -> bool:
    return abs(row[3]) > STANDSTILL[0] or abs(row[4]) > STANDSTILL[1]
