"""A plant that obeys the interface and nothing more, and a bench that speaks raw frames."""

import math
import struct
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from drives.canopen.frame import Frame
from sim_drives.canopen.dictionary import Entry, read_eds
from sim_drives.one_leg import Leg
from sim_drives.plant.actuation import Actuation, AxisActuation, AxisFlag, AxisSample
from sim_drives.settings import DriveSettings, FaultSettings
from sim_drives.time.wall_clock import now_ns
from sim_drives.world import World

CONFIGS = Path(__file__).parents[2] / "configs"
MS = 1_000_000
PERIOD_NS = 10 * MS


class FakePlant:
    """Two axes without mechanics: torque accelerates, ramps fall, holds stand, nothing is noisy."""

    inertia = (2.0, 30.0)
    effort_per_a = (5.5736, 27.08)

    def __init__(self, start_ns: int = 0) -> None:
        self.now_ns = start_ns
        self.position = [0.2, 0.3]
        self.velocity = [0.0, 0.0]
        self.load = [0.0, 0.0]
        self.orders: list[AxisActuation | None] = [None, None]
        self.history: list[tuple[int, int, AxisActuation]] = []
        self.blocked = [False, False]
        self.raised = [0, 0]
        self._error_s = [0.0, 0.0]

    def set_axis(self, axis: int, actuation: AxisActuation) -> None:
        self.orders[axis] = actuation
        self.history.append((self.now_ns, axis, actuation))

    def advance(self, to_ns: int) -> int:
        while self.now_ns < to_ns:
            step_ns = min(MS - self.now_ns % MS, to_ns - self.now_ns)
            before = tuple(self.raised)
            for axis in (0, 1):
                self._step(axis, step_ns * 1e-9)
            self.now_ns += step_ns
            if any(new & ~old for new, old in zip(self.raised, before, strict=True)):
                return self.now_ns
        return self.now_ns

    def _step(self, axis: int, step_s: float) -> None:
        order = self.orders[axis]
        assert order is not None
        kind = order.actuation
        flags = self.raised[axis] & (AxisFlag.END_STOP_NEGATIVE | AxisFlag.END_STOP_POSITIVE)
        if self.blocked[axis]:
            self.velocity[axis] = 0.0
        elif kind is Actuation.RAMP:
            fall = order.deceleration_si * step_s
            speed = self.velocity[axis]
            self.velocity[axis] -= max(-fall, min(fall, speed))
        elif kind is Actuation.HOLD:
            self.velocity[axis] = 0.0
        elif kind is Actuation.VELOCITY:
            change = order.target_velocity_si - self.velocity[axis]
            most = order.deceleration_si * step_s
            self.velocity[axis] += max(-most, min(most, change))
        elif kind is Actuation.POSITION:
            target = max(
                order.position_min_si, min(order.position_max_si, order.target_position_si)
            )
            if target != order.target_position_si:
                flags |= AxisFlag.TARGET_CLIPPED
            self.velocity[axis] = (target - self.position[axis]) / max(step_s, 0.01)
        else:
            effort = self.effort(axis) + self.load[axis]
            self.velocity[axis] += effort / self.inertia[axis] * step_s
        self.position[axis] += self.velocity[axis] * step_s
        if kind in (Actuation.RAMP, Actuation.HOLD) and self.velocity[axis] == 0.0:
            flags |= AxisFlag.STANDSTILL
        self.raised[axis] = flags | self._following(axis, order, step_s)

    def _following(self, axis: int, order: AxisActuation, step_s: float) -> int:
        error = abs(order.target_position_si - self.position[axis])
        if order.actuation is not Actuation.POSITION or error <= order.following_error_si:
            self._error_s[axis] = 0.0
            return AxisFlag.NONE
        self._error_s[axis] += step_s
        late = self._error_s[axis] >= order.following_error_time_s
        return AxisFlag.FOLLOWING_ERROR if late else AxisFlag.NONE

    def effort(self, axis: int) -> float:
        order = self.orders[axis]
        if order is None:
            return 0.0
        if order.actuation is Actuation.VELOCITY and self.blocked[axis]:
            return math.copysign(order.effort_limit_si, order.target_velocity_si)
        if order.actuation is not Actuation.TORQUE:
            return 0.0
        limit = order.effort_limit_si
        return max(-limit, min(limit, order.target_effort_si))

    def sample(self, axis: int) -> AxisSample:
        return AxisSample(
            position_si=self.position[axis],
            velocity_si=self.velocity[axis],
            current_a=self.effort(axis) / self.effort_per_a[axis],
            temperature_degc=31.4,
        )

    def flags(self, axis: int) -> int:
        return self.raised[axis]

    def block_rotor(self, axis: int, blocked: bool) -> None:
        self.blocked[axis] = blocked

    def wire_motor(self, axis: int, sense: int) -> None:
        raise AssertionError("wiring is the real plant's")

    def wire_encoder(self, axis: int, sense: int) -> None:
        raise AssertionError("wiring is the real plant's")

    def offset_current(self, axis: int, offset_a: float) -> None:
        raise AssertionError("the current sensor is the real plant's")


HIP = {
    "personality": "epos4",
    "node_id": 5,
    "eds": "drives/epos4.eds",
    "serial_number": 305_000_005,
    "boot_ms": 100.0,
    "encoder": "absolute",
    "counts_per_rev": 1024,
    "gear_ratio": 100.0,
    "sign": 1,
    "offset_rad": 0.0,
    "torque_constant_nm_per_a": 0.055736,
    "nominal_current_a": 5.0,
    "current_limit_a": 12.0,
    "position_limit": "clip",
    "limit_switch": "report",
    "tpdo_delay_min_ms": 0.1,
    "tpdo_delay_max_ms": 0.6,
    "tpdo_shuffled": False,
}
SLIDE = {key: value for key, value in HIP.items() if key != "offset_rad"} | {
    "node_id": 6,
    "serial_number": 305_000_006,
    "counts_per_rev": 512,
    "gear_ratio": 6.0,
    "lead_m": 0.15,
    "offset_m": 0.0,
    "sign": -1,
    "torque_constant_nm_per_a": 0.107746,
    "nominal_current_a": 6.0,
    "current_limit_a": 20.0,
}
GENERIC = {"personality": "generic", "eds": "drives/generic402.eds"}


def settings(table: dict[str, object], **changes: object) -> DriveSettings:
    return msgspec.convert(table | changes, DriveSettings)


@cache
def entries_of(eds: str, node_id: int) -> tuple[Entry, ...]:
    return read_eds(CONFIGS / eds, node_id)


class Bench:
    """A world on a fake plant, and the hand of a master that writes every byte itself."""

    def __init__(
        self,
        hip: dict[str, object] | None = None,
        slide: dict[str, object] | None = None,
        faults: Sequence[FaultSettings] = (),
        seed: int = 1,
        start_ns: int = 0,
        plant: Any = None,
    ) -> None:
        drives = settings(HIP, **(hip or {})), settings(SLIDE, **(slide or {}))
        entries = [entries_of(drive.eds, drive.node_id) for drive in drives]
        self.plant = FakePlant(start_ns) if plant is None else plant
        leg = Leg("right", self.plant, drives[0], entries[0], drives[1], entries[1])
        self.world = World([leg], faults, seed=seed, start_ns=start_ns)
        self.trace: list[Frame] = []

    # --- time and frames ---

    @property
    def now_ms(self) -> float:
        return self.world.now_ns / MS

    def run_ms(self, duration_ms: float) -> list[Frame]:
        sent = self.world.advance_to(self.world.now_ns + round(duration_ms * MS))
        self.trace += sent
        return sent

    def send(self, can_id: int, data: bytes = b"") -> None:
        self.world.receive(Frame(can_id, data))

    def ask(self, can_id: int, data: bytes = b"") -> list[Frame]:
        """Send, and take what is answered at once."""
        self.send(can_id, data)
        return self.run_ms(0)

    def frames(self, can_id: int) -> list[bytes]:
        return [timed.data for timed in self.trace if timed.can_id == can_id]

    def times_ms(self, can_id: int) -> list[float]:
        return [timed.time_ns / MS for timed in self.trace if timed.can_id == can_id]

    def forget(self) -> None:
        self.trace.clear()

    # --- services ---

    def nmt(self, command: int, node_id: int = 5) -> None:
        self.ask(0x000, bytes((command, node_id)))

    def boot(self) -> None:
        """Past boot-up and self-test: pre-operational, switch on disabled."""
        self.run_ms(400)

    def sdo(self, request: bytes, node_id: int = 5) -> bytes:
        answers = [
            timed.data
            for timed in self.ask(0x600 + node_id, request.ljust(8, b"\0"))
            if timed.can_id == 0x580 + node_id
        ]
        assert len(answers) == 1, answers
        return answers[0]

    def read(self, index: int, sub: int = 0, node_id: int = 5) -> int:
        answer = self.sdo(struct.pack("<BHB", 0x40, index, sub), node_id)
        assert answer[0] & 0xE3 == 0x43, answer.hex()
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little")

    def write(self, index: int, sub: int, value: int, size: int, node_id: int = 5) -> int:
        """Expedited download; 0, or the abort code (with its address checked)."""
        payload = (value % (1 << 8 * size)).to_bytes(size, "little")
        head = struct.pack("<BHB", 0x23 | (4 - size) << 2, index, sub)
        answer = self.sdo(head + payload, node_id)
        assert answer[1:4] == head[1:4], answer.hex()
        if answer[0] == 0x60:
            return 0
        assert answer[0] == 0x80, answer.hex()
        return int.from_bytes(answer[4:8], "little")

    def read_abort(self, index: int, sub: int = 0, node_id: int = 5) -> int:
        answer = self.sdo(struct.pack("<BHB", 0x40, index, sub), node_id)
        assert answer[0] == 0x80 and answer[1:4] == struct.pack("<HB", index, sub), answer.hex()
        return int.from_bytes(answer[4:8], "little")

    # --- the machine's cycle ---

    def map_pdos(self, node_id: int = 5, torque: int = 0x30D1_0220) -> None:
        """The service's mapping, written as a careful master does."""
        transmit = (
            (0, 0x180, 1, (0x6041_0010, 0x6064_0020, 0x6061_0008)),
            (1, 0x280, 1, (torque, 0x60FD_0020)),
        )
        receive = (
            (0, 0x200, 1, (0x6040_0010, 0x6060_0008, 0x607A_0020)),
            (1, 0x300, 1, (0x6071_0010,)),
        )
        for base, flags, plans in ((0x1800, 1 << 30, transmit), (0x1400, 0, receive)):
            for number in range(4):
                cob_id = self.read(base + number, 1, node_id)
                assert self.write(base + number, 1, cob_id | 1 << 31, 4, node_id) == 0
            for number, can_id, kind, entries in plans:
                self._map(base, number, flags | (can_id + node_id), kind, entries, node_id)

    def _map(
        self, base: int, number: int, cob_id: int, kind: int, entries: Sequence[int], node_id: int
    ) -> None:
        assert self.write(base + number, 2, kind, 1, node_id) == 0
        mapping = base + 0x200 + number
        assert self.write(mapping, 0, 0, 1, node_id) == 0
        for slot, entry in enumerate(entries, 1):
            assert self.write(mapping, slot, entry, 4, node_id) == 0
        assert self.write(mapping, 0, len(entries), 1, node_id) == 0
        assert self.write(base + number, 1, cob_id, 4, node_id) == 0

    def go_operational(self, node_id: int = 5, torque: int = 0x30D1_0220) -> None:
        self.map_pdos(node_id, torque)
        self.nmt(0x01, node_id)

    def cycle(
        self,
        controlword: int | None = None,
        mode: int = 10,
        position: int = 0,
        torque: int = 0,
        node_id: int = 5,
    ) -> list[Frame]:
        """One SYNC, its TPDOs, then the RPDOs of this cycle; ends at the next grid point."""
        self.send(0x080)
        sent = self.run_ms(2)
        if controlword is not None:
            self.send(0x200 + node_id, struct.pack("<Hbi", controlword, mode, position))
            self.send(0x300 + node_id, struct.pack("<h", torque))
        return sent + self.run_ms(8)

    def cycles(self, count: int, *args: int, **kwargs: int) -> None:
        for _ in range(count):
            self.cycle(*args, **kwargs)

    def enable(self, mode: int = 10, position: int = 0, torque: int = 0, node_id: int = 5) -> None:
        for controlword in (0x06, 0x07, 0x0F, 0x0F):
            self.cycles(2, controlword, mode, position, torque, node_id=node_id)
        assert self.state(node_id) == 0x27

    def statusword(self, node_id: int = 5) -> int:
        return self.read(0x6041, 0, node_id)

    def state(self, node_id: int = 5) -> int:
        """The bits that name the power state."""
        word = self.statusword(node_id)
        return word & (0x4F if word & 0x4F in (0x00, 0x40, 0x08, 0x0F) else 0x6F)


def booted_bench(
    hip: dict[str, object] | None = None, slide: dict[str, object] | None = None
) -> Bench:
    """A bench for `RealTime`: its drives have booted, before another node shares a bus with them.

    Their first boot-up messages are on no bus, or a busy machine delivers them after a later one
    is waited for.
    """
    bench = Bench(hip=hip, slide=slide, start_ns=now_ns() - 500 * MS)
    bench.boot()
    return bench
