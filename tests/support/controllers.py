"""Controllers in the hand of a lock-step script: each answers a record with setpoints."""

from collections.abc import Callable

from gaitd_names import Mode

from daemon.ipc.record import AxisSetpoint, CycleRecord, Setpoint
from gaitd_lab.lockstep_gateway import Gateway

NEUTRAL = (0.0, 0.0, 1.0)
Law = Callable[[CycleRecord], tuple[float, float, float]]
"""A record in; assist of hip and slide and a stiffness ratio out."""


class Controller:
    """Acquires the lease and answers each record, with nothing until torque or gait plays."""

    def __init__(self, gateway: Gateway, law: Law, legs: tuple[str, ...] = ("right",)) -> None:
        self.law, self.legs = law, legs
        self.seq = 0
        self.running = True
        """False: it hangs, and the gateway goes on forwarding its last word."""
        self.said: tuple[Setpoint, ...] = ()
        self.lease = gateway.grant_lease(self)

    def __call__(self, record: CycleRecord) -> tuple[Setpoint, ...]:
        if self.running:
            self.seq += 1
            self.said = tuple(self.setpoint(record, leg) for leg in self.legs)
        return self.said

    def setpoint(self, record: CycleRecord, leg: str) -> Setpoint:
        """For one leg."""
        active = record.mode in {Mode.TORQUE, Mode.GAIT}
        hip_nm, slide_n, stiffness_ratio = self.law(record) if active else NEUTRAL
        wanted = AxisSetpoint(hip_nm), AxisSetpoint(slide_n)
        return Setpoint(self.lease, self.seq, record.cycle, *wanted, leg, stiffness_ratio)


def constant(hip_nm: float = 0.0, slide_n: float = 0.0, stiffness_ratio: float = 1.0) -> Law:
    """The same in every cycle."""
    return lambda _: (hip_nm, slide_n, stiffness_ratio)


def towards(hip_rad: float, stiffness_nm_per_rad: float = 60.0, limit_nm: float = 18.0) -> Law:
    """A spring of the controller's own that draws the right hip to an angle."""

    def law(record: CycleRecord) -> tuple[float, float, float]:
        at_rad, speed = record.drives[0].position or 0.0, record.drives[0].velocity or 0.0
        wanted_nm = stiffness_nm_per_rad * (hip_rad - at_rad) - 8.0 * speed
        return min(max(wanted_nm, -limit_nm), limit_nm), 0.0, 1.0

    return law
