"""The session of a column: the shipped configuration with the differences that its cells need.

In addition to plant.toml, the patient can push each joint into its stop, and the leg can be guided
by hand. All random values come from the seed: the same seed gives the same frames.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import msgspec
from gaitd_toml import load_toml

from daemon.config.bundle import Settings
from daemon.config.settings import Robot
from daemon.config.trainer import beside
from daemon.preflight.files import check_together
from daemon.preflight.load import read_all
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.proven_signs import proven_signs
from gaitd_lab.virtual_machine import load_plant, virtual_machine
from sim_drives.build import Machine
from sim_drives.plant.settings import (
    HipEffort,
    HipWave,
    Programme,
    Sine,
    SlideEffort,
    SlideWave,
    Steady,
)

Guidance = Literal["impedance", "position"]

EMPTY: Final = "robot_empty.toml"
PUSH_NM: Final = 90.0
PUSH_N: Final = 700.0
"""Patient's effort into a stop: more than the drive's limit can hold."""
PUSH_RISE_S: Final = 0.4
LEAD_NM: Final = 11.0
LEAD_N: Final = 100.0
"""Patient's effort in hand guiding: above breakaway friction, slower than hand guiding allows."""
LEAN_NM: Final = 8.0
LEAN_N: Final = 50.0
"""Effort of a patient who is not quite at rest."""
SLOWLY_HZ: Final = 0.3
HOUR_S: Final = 3600.0


@dataclass(frozen=True, slots=True)
class Variant:
    """Differences between a cell's configuration and the trainer file."""

    guidance: Guidance = "impedance"
    empty: bool = False
    """True if the machine is empty: one axis alone may be moved."""


def matrix_session(config: Path, variant: Variant, seed: int) -> LockstepSession:
    """Read all files and build machine and service, whose signs are proven.

    Raises:
        ConfigError: in a file, or between the files.
    """
    settings = _varied(read_all(config), config, variant)
    check_together(settings)
    machine = _machine(settings, variant, seed)
    return LockstepSession(settings, machine, persistent=proven_signs(settings, machine))


def _varied(settings: Settings, config: Path, variant: Variant) -> Settings:
    trainer = settings.trainer
    gait = msgspec.structs.replace(trainer.gait, guidance=variant.guidance)
    file = replace(settings.file, trainer=msgspec.structs.replace(trainer, gait=gait))
    return replace(settings, file=file, robot=_robot(settings.robot, config, variant))


def _robot(robot: Robot, config: Path, variant: Variant) -> Robot:
    if not variant.empty:
        return robot
    return load_toml(beside(config, EMPTY), Robot)


def _machine(settings: Settings, variant: Variant, seed: int) -> Machine:
    path, plant = load_plant(settings.file)
    patient = msgspec.structs.replace(
        plant.patient, programme=(*plant.patient.programme, *_into_stops(), *_by_hand())
    )
    return virtual_machine(
        settings.file,
        plant=msgspec.structs.replace(plant, patient=patient),
        robot=load_toml(beside(path, EMPTY), Robot) if variant.empty else None,
        seed=seed,
    )


def _into_stops() -> tuple[Programme, ...]:
    """Programmes that push each joint with full weight towards its upper stop."""
    return tuple(
        Programme(f"into_{axis}_stop", effort=(_lean(hip_nm, slide_n),))
        for axis, hip_nm, slide_n in (("hip", PUSH_NM, 0.0), ("slide", 0.0, PUSH_N))
    )


def _lean(hip_nm: float, slide_n: float) -> Steady:
    rise_s = PUSH_RISE_S
    return Steady(
        at_s=0.0,
        until_s=HOUR_S,
        rise_s=rise_s,
        fall_s=rise_s,
        hip=HipEffort(torque_nm=hip_nm),
        slide=SlideEffort(force_n=slide_n),
    )


def _by_hand() -> tuple[Programme, ...]:
    return (_slowly("led", LEAD_NM, LEAD_N), _slowly("leans", LEAN_NM, LEAN_N))


def _slowly(name: str, hip_nm: float, slide_n: float) -> Programme:
    """Efforts that move one joint after the other slowly up and down."""
    effort = Sine(
        at_s=0.0,
        until_s=HOUR_S,
        rise_s=1.0,
        fall_s=1.0,
        hip=HipWave(torque_nm=hip_nm, phase_deg=0.0),
        slide=SlideWave(force_n=slide_n, phase_deg=90.0),
        frequency_hz=SLOWLY_HZ,
    )
    return Programme(name, effort=(effort,))
