"""One service and one virtual machine in lock-step, brought to the start of a cell.

In addition to plant.toml, the patient can push each joint into its stop, and the leg can be guided
by hand. All random values come from the seed: the same seed gives the same frames.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import msgspec

from daemon.config.bundle import Settings
from daemon.config.robot import friction_parameters, leg_parameters
from daemon.config.settings import Robot
from daemon.config.strict import ConfigError, load_toml
from daemon.config.trainer import beside
from daemon.ipc.record import Mode, ModeRequest, Outcome, RequestKind
from daemon.preflight.files import check_together
from daemon.preflight.load import read_all
from gaitd_lab.fault_matrix.gateway import TroubledGateway
from gaitd_lab.lockstep import Lockstep
from gaitd_lab.virtual_machine import load_plant
from sim_drives.build import Machine, MachineError, build_machine
from sim_drives.plant.settings import Programme, Sine, Steady

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


class Bench:
    """A session from power-on; `lockstep` is replaced when the core is restarted."""

    def __init__(self, config: Path, variant: Variant, seed: int) -> None:
        """Read all files and build machine and service.

        Raises:
            ConfigError: in a file, or between the files.
        """
        self.settings = _varied(read_all(config), config, variant)
        check_together(self.settings)
        self.machine = _machine(self.settings, variant, seed)
        self.gateway = TroubledGateway()
        self.lockstep = Lockstep(self.settings, self.machine.world, gateway=self.gateway)
        self.bus = self.lockstep.bus

    @property
    def world_ns(self) -> int:
        """The world's time, independent of the service's clock."""
        return self.machine.world.now_ns

    @property
    def mode(self) -> Mode:
        """Mode of the newest record; OFF before the first."""
        return self.lockstep.record.mode if self.lockstep.records else Mode.OFF

    def restart_core(self) -> None:
        """Start a new core on the same bus, with the state file of the last one."""
        notes = self.lockstep.notebook.notes
        self.gateway = TroubledGateway()
        self.lockstep = Lockstep(
            self.settings, self.machine.world, notes=notes, bus=self.bus, gateway=self.gateway
        )

    # --- reaching a mode --------------------------------------------------------------------------

    def until(self, mode: Mode, within_s: float = 10.0) -> None:
        """Run until the service is in a mode.

        Raises:
            NotReachedError: the mode was not reached in that time.
        """
        self.lockstep.run_until(lambda record: record.mode == mode, within_s)

    def until_ready(self) -> None:
        """Run from power-on until the service is ready."""
        self.until(Mode.READY)
        self.lockstep.run(0.2)

    def ask(self, kind: RequestKind, wanted: ModeRequest | None = None) -> None:
        """Send a request that must be accepted.

        Raises:
            RefusedError: it was refused.
        """
        answer = self.lockstep.request(kind, wanted)
        if answer.outcome != Outcome.DONE:
            raise RefusedError(f"{kind.name.lower()} {wanted or ''}: {answer.reason}")

    def enable(self) -> None:
        """Run from power-on to holding."""
        self.until_ready()
        self.ask(RequestKind.ENABLE)

    def patient(self, programme: str) -> None:
        """Start a programme of the patient: plant.toml's, `into_AXIS_stop`, `led`, `leans`."""
        self.machine.command(f"patient {programme}")


class RefusedError(Exception):
    """The service refused a request on the way to a mode; the message gives the reason."""


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
    robot = load_toml(beside(path, EMPTY if variant.empty else plant.robot), Robot)
    patient = msgspec.structs.replace(
        plant.patient, programme=(*plant.patient.programme, *_into_stops(), *_by_hand())
    )
    try:
        return build_machine(
            msgspec.structs.replace(plant, patient=patient),
            path.parent,
            leg_parameters(robot),
            friction_parameters(robot),
            seed=seed,
        )
    except MachineError as error:
        raise ConfigError(path, error.key, error.value, error.allowed) from error


def _into_stops() -> tuple[Programme, ...]:
    """Programmes that push each joint with full weight towards its upper stop."""
    return tuple(
        Programme(f"into_{axis}_stop", effort=(_lean(hip_nm, slide_n),))
        for axis, hip_nm, slide_n in (("hip", PUSH_NM, 0.0), ("slide", 0.0, PUSH_N))
    )


def _lean(hip_nm: float, slide_n: float) -> Steady:
    rise_s = PUSH_RISE_S
    return Steady(
        at_s=0.0, until_s=HOUR_S, rise_s=rise_s, fall_s=rise_s, hip_nm=hip_nm, slide_n=slide_n
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
        hip_nm=hip_nm,
        slide_n=slide_n,
        frequency_hz=SLOWLY_HZ,
        hip_phase_deg=0.0,
        slide_phase_deg=90.0,
    )
    return Programme(name, effort=(effort,))
