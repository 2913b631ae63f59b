"""A real hip drive on a bench, as far as a computer can play one: durand's CANopen, a bare motor.

Protocol stack (durand), power states (`third_model.py`) and motor are none of `sim_drives`. The
numbers are those of hip_generic.toml and hip_epos4.toml, worked out by hand. Its own loops are
ideal: in cyclic position it is where it is told to be, a stop brakes at `BRAKING_RAD_PER_S2`.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from config_files import Change, changed, copied
from durand_slave import DurandWorld

from daemon.preflight.load import load
from drives.canopen.frame import Frame
from drives.cia402.profile import DriveDescription

COUNTS_PER_RAD = 1024 * 100 / (2 * math.pi)
NM_PER_PERMILLE = 0.279 * 100 / 1000
MILLIAMPERE_PER_PERMILLE = 5
INERTIA_KG_M2 = 0.35
FRICTION_NM = 2.5
BRAKING_RAD_PER_S2 = 14.0
STEP_S = 0.002
INPUTS = 0x0003_0000
"""60FDh: hand switch closed, STO released."""
SYNC = 0x080
TORQUE, POSITION = 10, 8
BENCH = (
    # durand has no homing: its encoder is absolute, and believed.
    Change("hil.toml", 'without_stored_pose = "home"', 'without_stored_pose = "believe"'),
    Change("hil.toml", "announce_s = 3.0", "announce_s = 0.5"),
    Change("hil.toml", "ramp_strides = 2", "ramp_strides = 1"),
)


def bench(folder: Path, *more: Change, kind: str = "generic") -> Path:
    """A copy of configs/ with durand's drive in hil.toml; returns that file."""
    drive = Change("hil.toml", "drives/hip_bench_epos4.toml", f"drives/hip_{kind}.toml")
    return changed(copied(folder), drive, *BENCH, *more).with_name("hil.toml")


class BenchWorld(DurandWorld):
    """One drive with a motor that turns nothing."""

    def __init__(self, hip: DriveDescription, start_rad: float = 0.244) -> None:
        super().__init__([hip])
        self.hip = self.drives[0]
        self.is_epos4 = hip.profile.family == "EPOS4"
        self.position_rad, self.speed_rad_per_s = start_rad, 0.0
        self._moved_ns = self.now_ns
        self.hip.dictionary.write(0x60FD, 0, INPUTS)
        self._latch()

    def receive(self, frame: Frame) -> None:
        if frame.can_id == SYNC:
            self._latch()
        super().receive(frame)

    def _latch(self) -> None:
        self.hip.dictionary.write(0x6064, 0, round(self.position_rad * COUNTS_PER_RAD))
        powered = self.hip.model.state == "operation enabled"
        torque = self.hip.dictionary.read(0x6071, 0) if powered else 0
        self.hip.dictionary.write(0x6077, 0, torque)
        if self.is_epos4:
            self.hip.dictionary.write(0x30D1, 2, torque * MILLIAMPERE_PER_PERMILLE)

    def _run_to(self, time_ns: int) -> None:
        while self._moved_ns + STEP_S * 1e9 <= time_ns:
            self._moved_ns += round(STEP_S * 1e9)
            self._move()
        super()._run_to(time_ns)

    def _move(self) -> None:
        read, state = self.hip.dictionary.read, self.hip.model.state
        mode, torque_nm, slowing = read(0x6061, 0), 0.0, FRICTION_NM / INERTIA_KG_M2
        if state == "operation enabled" and mode == POSITION:
            target_rad = read(0x607A, 0) / COUNTS_PER_RAD
            self.speed_rad_per_s = (target_rad - self.position_rad) / STEP_S
            self.position_rad = target_rad
            return
        if state == "operation enabled" and mode == TORQUE:
            torque_nm = read(0x6071, 0) * NM_PER_PERMILLE
        elif state == "quick stop active":
            slowing = BRAKING_RAD_PER_S2
        driven = self.speed_rad_per_s + torque_nm / INERTIA_KG_M2 * STEP_S
        self.speed_rad_per_s = math.copysign(max(abs(driven) - slowing * STEP_S, 0.0), driven)
        self.position_rad += self.speed_rad_per_s * STEP_S


def play(config: Path) -> None:
    """Be the drive of the bench on the bus of a configuration, by the computer's clock, for ever.

    Only the waiting for frames is that of `gaitd sim`.
    """
    from sim_drives.time.wall_clock import RealTime, open_bus

    settings = load(config)
    table = settings.trainer.bus
    with open_bus(table.interface, table.channel, table.bitrate_bit_per_s) as bus:
        print("a drive on the bench", flush=True)
        RealTime(BenchWorld(settings.drives[0]), bus).run(lambda: False)


class OneBus:
    """Several worlds on one bus: what one sends, the others receive at that time."""

    def __init__(self, *worlds: Any) -> None:
        self.worlds: Sequence[Any] = worlds
        self.sent: list[list[Frame]] = [[] for _ in worlds]
        """Frames that each has sent."""

    @property
    def now_ns(self) -> int:
        return self.worlds[0].now_ns

    def receive(self, frame: Frame) -> None:
        for world in self.worlds:
            world.receive(frame)

    def next_event_ns(self) -> int:
        return min(world.next_event_ns() for world in self.worlds)

    def advance_to(self, time_ns: int) -> list[Frame]:
        sent: list[Frame] = []
        while True:
            step_ns = max(min(self.next_event_ns(), time_ns), self.now_ns)
            for number, world in enumerate(self.worlds):
                for frame in world.advance_to(step_ns):
                    sent.append(frame)
                    self.sent[number].append(frame)
                    self._hand_on(frame, world.receive)
            if step_ns == time_ns and self.next_event_ns() > time_ns:
                return sent

    def _hand_on(self, frame: Frame, sender: Callable[[Frame], None]) -> None:
        for world in self.worlds:
            if world.receive != sender:
                world.receive(frame)
