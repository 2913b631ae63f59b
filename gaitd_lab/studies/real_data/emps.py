"""The EMPS benchmark: a maxon motor moves a carriage of 95 kg over a ball screw.

Two records of 25 s under position control: one to identify from, and one to validate on, in which
known pulses of voltage were added to the drive's command. Positions are of the motor's encoder, as
metres of the carriage; forces are the command times the drive's gain.

Source: A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Workshop on
Nonlinear System Identification Benchmarks, 2019. The files are its own, `DATA_EMPS.mat` and
`DATA_EMPS_PULSES.mat`; they state no licence.

gaitd's observer takes the carriage as the slide of a leg without weight, whose hip stands still.
"""

from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from analysis.recording import Recording, RecordingError, recording
from daemon.config.edits import replaced
from daemon.config.settings import Robot
from observer.filter.leg_model import STEP_S

Values = NDArray[np.float64]

FILES: Final = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")
SAMPLE_S: Final = 1e-3
SAMPLES: Final = round(STEP_S / SAMPLE_S)
"""Samples of the files in a row of ours."""
PUBLISHED_MASS_KG: Final = 95.1089
PUBLISHED_VISCOUS_N_S_PER_M: Final = 203.5034
PUBLISHED_COULOMB_N: Final = 20.3935
PUBLISHED_OFFSET_N: Final = -3.1648
"""Parameters that the benchmark's authors identified from the first record."""
HIP_RAD: Final = 0.2440
SLIDE_M: Final = 0.5905
"""Pose in the middle of the record: that of a leg at mid gait."""
TRANSITION_M_PER_S: Final = 0.001
PEAK_M_PER_S: Final = 0.006
EDGE_M_PER_S: Final = 0.004


class Record(NamedTuple):
    """A record in rows of 10 ms."""

    recording: Recording
    """Effort: mean force over the row, as the drive exerted it, with the pulses."""
    pulses_n: Values
    """Shape (n,): part of that force which is known pulses."""
    edges_s: Values
    """Times at which a pulse begins or ends."""


def read(folder: Path) -> tuple[Record, Record]:
    """Read the record to identify from, and the one to validate on.

    Raises:
        OSError: a file cannot be opened.
        RecordingError: a file is none of the benchmark's; names variable, value and what is
            allowed.
    """
    identification, validation = (_record(folder / name) for name in FILES)
    if not np.any(validation.pulses_n):
        raise RecordingError(f"{folder / FILES[1]}: pulses_N is 0 throughout; it must have pulses")
    return identification, validation


def _record(path: Path) -> Record:
    try:
        with path.open("rb") as file:
            found = loadmat(file)
    except (ValueError, NotImplementedError, MatReadError) as error:
        raise RecordingError(f"{path}: is no MATLAB file of version 7 or older: {error}") from error
    position, command = (_column(path, found, name) for name in ("qm", "vir"))
    gain_n_per_v = float(_column(path, found, "gtau")[0])
    if len(position) != len(command) or len(position) < 2 * SAMPLES:
        raise RecordingError(
            f"{path}: qm has {len(position)} samples and vir {len(command)}; both must have the "
            f"same number, at least {2 * SAMPLES}"
        )
    pulses = np.zeros(len(command))
    if "pulses_N" in found:
        pulses = _pulses(path, _column(path, found, "pulses_N"), command)
    rows = np.arange(1, len(position) // SAMPLES)
    middle_m = 0.5 * float(position.min() + position.max())
    table = np.empty((len(rows), 5))
    table[:, 0] = rows * STEP_S
    table[:, 1] = HIP_RAD
    table[:, 2] = position[rows * SAMPLES] - middle_m + SLIDE_M
    table[:, 3] = 0.0
    table[:, 4] = gain_n_per_v * _means(command, len(rows))
    edges_s = (np.flatnonzero(np.diff(pulses)) + 1).astype(np.float64) * SAMPLE_S
    made = recording(str(path), table)
    return Record(made, gain_n_per_v * _means(pulses, len(rows)), edges_s)


def _column(path: Path, found: dict[str, Any], name: str) -> Values:
    if name not in found:
        has = ", ".join(key for key in found if not key.startswith("__"))
        raise RecordingError(f"{path}: lacks the variable {name}; it has {has or 'none'}")
    value = np.asarray(found[name])
    if value.dtype.kind not in "fiu" or value.size == 0 or not np.all(np.isfinite(value)):
        raise RecordingError(f"{path}: {name} must be finite numbers")
    return value.ravel().astype(np.float64)


def _pulses(path: Path, marked: Values, command_v: Values) -> Values:
    """Voltage of the pulses where the file marks one.

    The file rounds their height; the command steps by the true one from one sample to the next.
    """
    if len(marked) != len(command_v):
        raise RecordingError(
            f"{path}: pulses_N has {len(marked)} samples and vir {len(command_v)}; both must have "
            "the same number"
        )
    on = (marked > 0.0).astype(np.float64)
    steps = np.abs(np.diff(command_v))[np.diff(on) != 0.0]
    return on * float(np.median(steps)) if len(steps) else on


def _means(samples: Values, count: int) -> Values:
    """Means over the time before each row: a command acts from its sample to the next."""
    return samples[: count * SAMPLES].reshape(count, SAMPLES).mean(axis=1)


def one_axis(robot: Robot, *, coulomb_n: float, viscous_n_s_per_m: float, mass_kg: float) -> Robot:
    """Change a robot into a leg without weight, springs and dampers on a heavy slide."""
    replace = msgspec.structs.replace
    light = {"mass_kg": 1e-3, "inertia_kg_m2": 1e-5}
    return replace(
        robot,
        thigh=replace(robot.thigh, **light),
        shank=replace(robot.shank, **light),
        shoe=replace(robot.shoe, **light),
        slide=replace(robot.slide, mass_kg=1e-3, drive_mass_kg=mass_kg),
        springs=replaced(
            robot.springs, {"hip.stiffness_nm_per_rad": 0.0, "slide.stiffness_n_per_m": 0.0}
        ),
        dampers=replace(
            robot.dampers,
            hip_nm_s_per_rad=0.0,
            knee_nm_s_per_rad=0.0,
            ankle_nm_s_per_rad=0.0,
            slide_joint_nm_s_per_rad=0.0,
        ),
        friction=replace(
            robot.friction,
            slide=replace(
                robot.friction.slide,
                coulomb_n=coulomb_n,
                stribeck_n=coulomb_n + 0.01 * viscous_n_s_per_m,
                viscous_n_s_per_m=viscous_n_s_per_m,
                transition_m_per_s=TRANSITION_M_PER_S,
                peak_m_per_s=PEAK_M_PER_S,
                edge_m_per_s=EDGE_M_PER_S,
            ),
        ),
    )


def published(robot: Robot) -> Robot:
    """Change a robot into the benchmark's axis, with its authors' parameters."""
    return one_axis(
        robot,
        coulomb_n=PUBLISHED_COULOMB_N,
        viscous_n_s_per_m=PUBLISHED_VISCOUS_N_S_PER_M,
        mass_kg=PUBLISHED_MASS_KG,
    )
