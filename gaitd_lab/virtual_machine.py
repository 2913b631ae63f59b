"""The virtual drives of a configuration, built but not running: for `sim`, `demo` and tests."""

from collections.abc import Collection, Mapping
from pathlib import Path

from gaitd_toml import MISSING, ConfigError, load_toml

from daemon.config.robot import friction_over_position, friction_parameters, leg_parameters
from daemon.config.settings import Robot
from daemon.config.trainer import TrainerFile, beside, is_file
from daemon.preflight.load import read_all
from drives.cia402.pdo import layouts
from drives.cia402.profile import DriveDescription
from drives.cia402.units import axis_scaling, expected_base, position_si
from sim_drives.build import Machine, MachineError, build_machine
from sim_drives.one_leg import Outsider
from sim_drives.plant.plant import Physics
from sim_drives.plant.truth import TruthLog
from sim_drives.settings import PlantFile


def load_plant(trainer: TrainerFile) -> tuple[Path, PlantFile]:
    """Read plant.toml of a trainer file; return it with its path.

    Raises:
        ConfigError: the trainer file names none, or it cannot be used.
    """
    if trainer.sim is None:
        allowed = "the plant.toml of the virtual drives"
        raise ConfigError(trainer.path, "sim", MISSING, allowed, following="")
    return trainer.sim, load_toml(trainer.sim, PlantFile)


def load_robot(path: Path, plant: PlantFile) -> Robot:
    """Read the robot file that a plant.toml, at `path`, names.

    Raises:
        ConfigError: there is none, or it cannot be used.
    """
    file = beside(path, plant.robot)
    if not is_file(file):
        raise ConfigError(path, "robot", plant.robot, f"a file that exists; there is no {file}")
    return load_toml(file, Robot)


def virtual_machine(
    trainer: TrainerFile,
    *,
    plant: PlantFile | None = None,
    robot: Robot | None = None,
    seed: int | None = None,
    start_ns: int = 0,
    truth: Mapping[str, TruthLog] | None = None,
    without: Collection[str] = (),
) -> Machine:
    """Build the machine that a trainer file's plant.toml describes.

    Args:
        trainer: the trainer file.
        plant: replaces its plant.toml.
        robot: replaces the plant's robot file.
        seed: replaces plant.toml's own.
        start_ns: the first time of the machine's clock.
        truth: receives the truth at each SYNC, by leg.
        without: drives, LEG/AXIS, that are not simulated here; their axes move as the position in
            their TPDO1 says, in the units of their axis files.

    Raises:
        ConfigError: plant.toml, its robot file, or an EDS; with `without` any file of the service.
    """
    path, own = load_plant(trainer)
    plant = plant or own
    robot = robot or load_robot(path, plant)
    try:
        return build_machine(
            plant,
            path.parent,
            Physics(
                leg_parameters(robot),
                friction_parameters(robot),
                (robot.hip.drive_inertia_kg_m2, robot.slide.drive_mass_kg),
                friction_over_position(robot),
            ),
            seed=seed,
            start_ns=start_ns,
            truth=truth,
            outsiders=_outsiders(trainer, without) if without else {},
        )
    except MachineError as error:
        raise ConfigError(path, error.key, error.value, error.allowed) from error


def _outsiders(trainer: TrainerFile, names: Collection[str]) -> dict[str, Outsider]:
    """Drives on the bus that are not simulated, by their axis files."""
    period_s = trainer.trainer.cycle.period_ms * 1e-3
    drives = {drive.name: drive for drive in read_all(trainer.path).drives}
    return {name: _outsider(drives[name], period_s) for name in names}


def _outsider(drive: DriveDescription, period_s: float) -> Outsider:
    status = layouts(drive.profile, drive.node_id).status
    scaling = axis_scaling(drive, expected_base(drive))

    def position(data: bytes) -> float | None:
        if len(data) != status.size:
            return None
        return position_si(status.codec.unpack(data)[1], scaling)

    return Outsider(status.can_id, position, period_s)
