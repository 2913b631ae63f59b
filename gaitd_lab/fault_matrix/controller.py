"""A controller for column `torque`: it moves the hip slowly up and down, like an external one."""

import math

from gaitd_names import Mode

from daemon.ipc.record import AxisSetpoint, CycleRecord, Setpoint
from gaitd_lab.lockstep import Gateway

SWING_RAD = 0.12
PERIOD_CYCLES = 300
STIFFNESS_NM_PER_RAD = 150.0
DAMPING_NM_S_PER_RAD = 8.0
ASSIST_MAX_NM = 18.0


class Swinger:
    """Holds the lease and answers each record; without a setpoint until mode torque is active."""

    def __init__(self, gateway: Gateway, leg: str) -> None:
        self._leg = leg
        self._seq = 0
        self._begun_cycle: int | None = None
        self._middle_rad = 0.0
        self._lease = gateway.grant_lease(self)

    def __call__(self, record: CycleRecord) -> tuple[Setpoint, ...]:
        """Return the setpoint for the newest record."""
        self._seq += 1
        assist_nm = self._assist_nm(record) if record.mode == Mode.TORQUE else 0.0
        return (
            Setpoint(self._lease, self._seq, record.cycle, AxisSetpoint(assist_nm), leg=self._leg),
        )

    def _assist_nm(self, record: CycleRecord) -> float:
        hip = record.drives[0]
        at_rad, speed_rad_per_s = hip.position or 0.0, hip.velocity or 0.0
        if self._begun_cycle is None:
            self._begun_cycle, self._middle_rad = record.cycle, at_rad
        phase = 2 * math.pi * (record.cycle - self._begun_cycle) / PERIOD_CYCLES
        wanted_rad = self._middle_rad + SWING_RAD * math.sin(phase)
        wanted_nm = STIFFNESS_NM_PER_RAD * (wanted_rad - at_rad)
        wanted_nm -= DAMPING_NM_S_PER_RAD * speed_rad_per_s
        return min(max(wanted_nm, -ASSIST_MAX_NM), ASSIST_MAX_NM)
