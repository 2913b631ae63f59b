"""Faults drawn from a seed; each named after its row of the fault matrix.

Not drawn: a drive's refusals at bring-up (another identity, a refused object), because they end
the core with exit code 3, as required.

Deaths of processes are drawn in the first part only: memory growth is measured on processes that
stay alive.
"""

import random
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from types import MappingProxyType
from typing import Final, NamedTuple

from gaitd_names import Cause

from gaitd_lab.fault_matrix.faults import EMERGENCIES, LAWS, WARNING_CODE
from gaitd_lab.fault_matrix.law import Law, goes_on

PAUSE_MEAN_S: Final = 4.0
PAUSE_MIN_S: Final = 1.0
DEATHS_RATIO: Final = 0.2
"""Share of the duration with deaths; afterwards processes are halted at most."""
_STAYS: Final = 12.0
"""Longer than a stride: a fault that shows in motion is detected."""


class Actor(Enum):
    """Executor of the fault."""

    DRIVE = "a virtual drive"
    PATIENT = "the patient"
    KILL = "SIGKILL"
    HALT = "SIGSTOP, and SIGCONT later"
    FLOOD = "a client without a lease"


@dataclass(frozen=True, slots=True)
class Source:
    """One kind of fault."""

    actor: Actor
    words: str
    """Commands to the drives, with `{drive}` and `{s}`, separated by `;`; a programme of the
    patient; or the process.
    """
    low_s: float
    high_s: float
    every: bool = False
    """True if it may affect all drives at once."""
    weight_ratio: float = 1.0
    law: Law | None = None
    """Expected result, where the matrix has no such row, or uses a shorter time."""


class ActiveFault(NamedTuple):
    """One fault, at the present time."""

    name: str
    actor: Actor
    words: str
    drive: str
    duration_s: float
    law: Law

    def __str__(self) -> str:
        where = f" {self.drive}" if self.drive else ""
        return f"{self.name}{where}, {self.duration_s:.2f} s"


def _drive(words: str, low_s: float, high_s: float, *, every: bool = False) -> Source:
    return Source(Actor.DRIVE, words, low_s, high_s, every)


def _blind(words: str, row: str) -> Source:
    """Wrong encoder until the fault is over: the joint may reach its limit switch undetected."""
    law = replace(LAWS[row], causes=LAWS[row].causes | {Cause.LIMIT_SWITCH})
    return Source(Actor.DRIVE, words, _STAYS, _STAYS, law=law)


def _patient(programme: str, law: Law | None = None) -> Source:
    return Source(Actor.PATIENT, programme, 3.0, 8.0, law=law)


SOURCES: Final[Mapping[str, Source]] = MappingProxyType(
    {
        "silent": _drive("silent {drive} {s}", 0.2, 3.0, every=True),
        "unplugged": _drive("unplugged {drive} {s}", 0.2, 3.0, every=True),
        "deaf": _drive("deaf {drive} {s}", 0.2, 3.0, every=True),
        "tpdo_lost_once": _drive("lost_tpdo {drive} 0.010", 0.01, 0.01, every=True),
        "tpdo_lost": _drive("lost_tpdo {drive} {s} 2", 0.2, 2.0, every=True),
        "tpdo_late_2ms": _drive("late_tpdo {drive} {s} 2", 0.5, 3.0, every=True),
        "tpdo_late_6ms": _drive("late_tpdo {drive} {s} 6", 0.2, 2.0, every=True),
        "rebooted": _drive("reboot {drive} 0.010", 0.01, 0.01, every=True),
        "drive_bus_off": _drive("bus_off {drive} {s}", 0.2, 3.0),
        "drive_error_passive": _drive("bus_passive {drive} {s}", 0.2, 2.0),
        **{
            f"emcy_{error_class:x}xxx_fault": Source(
                Actor.DRIVE, f"emcy {{drive}} {{s}} {code:#06x}", 0.3, 1.5, weight_ratio=0.25
            )
            for error_class, (code, _) in EMERGENCIES.items()
        },
        "emcy_warning": _drive(f"emcy_warning {{drive}} {{s}} {WARNING_CODE:#06x}", 0.3, 1.5),
        "encoder_frozen": _blind("frozen_encoder {drive} {s}", "encoder_frozen"),
        "encoder_jump_once": _drive("encoder_glitch {drive} 0.010 4000", 0.01, 0.01),
        "encoder_reversed": _blind("encoder_reversed {drive} {s}", "encoder_reversed"),
        "wrong_sign": _drive("wrong_sign {drive} {s}", _STAYS, _STAYS),
        "torque_offset": _drive("torque_offset {drive} {s} 3000", _STAYS, _STAYS),
        "blocked_rotor": _drive("blocked_rotor {drive} {s}", _STAYS, _STAYS),
        "brake_stuck": _drive("brake_stuck {drive} {s}", _STAYS, _STAYS),
        "limit_switch": _drive("limit_switch_on {drive} {s} 1", _STAYS, _STAYS),
        "hand_switch": _drive("hand_switch_open {drive} {s}", 0.3, 3.0, every=True),
        "sto": _drive("sto_open {drive} {s}", 0.3, 3.0, every=True),
        "deaf_to_quick_stop": _drive(
            "ignores_quick_stop {drive} {s};hand_switch_open {drive} {s}", 2.0, 2.0
        ),
        "spasm": _patient("spasm"),
        "patient_active": _patient("active", goes_on("a patient who takes part")),
        "patient_resists": _patient("resisting", goes_on("a patient who is pulled along")),
        "gateway_35ms": Source(Actor.HALT, "gateway", 0.035, 0.035),
        "gateway_2s": Source(Actor.HALT, "gateway", 2.0, 2.0),
        "core_2s": Source(Actor.HALT, "core", 2.0, 2.0),
        "gateway_dead": Source(Actor.KILL, "gateway", 1.0, 3.0, weight_ratio=4.0),
        "core_sigkill": Source(Actor.KILL, "core", 1.0, 2.0, weight_ratio=4.0),
        "setpoint_flood": Source(
            Actor.FLOOD,
            "",
            2.0,
            4.0,
            law=goes_on("setpoints without a lease are refused and counted, however many"),
        ),
    }
)
"""Kinds of fault by name."""


class FaultGenerator:
    """The random generator of one run."""

    def __init__(self, seed: int, drives: tuple[str, ...]) -> None:
        self._rng = random.Random(f"{seed}/happens")
        self._walks = random.Random(f"{seed}/walks")
        self._drives = drives

    def pause_s(self) -> float:
        """Draw the time of gait until the next fault."""
        return PAUSE_MIN_S + self._rng.expovariate(1.0 / PAUSE_MEAN_S)

    def walk(self) -> dict[str, object]:
        """Draw the arguments of mode gait."""
        return {
            "mode": "gait",
            "cadence_hz": round(self._walks.uniform(0.2, 0.5), 3),
            "amplitude_ratio": round(self._walks.uniform(0.6, 1.0), 3),
            "duration_s": round(self._walks.uniform(60.0, 300.0), 1),
        }

    def next(self, *, deaths: bool) -> ActiveFault:
        """Draw the next fault.

        Args:
            deaths: a process may be killed.
        """
        rng = self._rng
        names = [name for name, one in SOURCES.items() if deaths or one.actor is not Actor.KILL]
        name = rng.choices(names, [SOURCES[name].weight_ratio for name in names])[0]
        source = SOURCES[name]
        drive = rng.choice((*self._drives, "*") if source.every else self._drives)
        duration_s = round(rng.uniform(source.low_s, source.high_s), 3)
        of_drive = source.actor is Actor.DRIVE
        words = source.words.format(drive=drive, s=duration_s).replace(";", "\n")
        where = drive if of_drive else ""
        return ActiveFault(name, source.actor, words, where, duration_s, source.law or LAWS[name])
