"""The measured hip moment of a walking person, as the file of a scripted patient.

Source: A. Falisse, G. Serrancolí, C. L. Dembia, J. Gillis, I. Jonkers, F. De Groote, "Rapid
predictive simulations with complex musculoskeletal models suggest that diverse healthy and
pathological human gaits can emerge from similar control strategies", J. R. Soc. Interface 16 (2019)
20190402. `ExperimentalData.mat` of its repository, MIT licence: one person, 11 strides on level
ground, joint angles in degrees and moments from inverse dynamics.
"""

import csv
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from analysis.recording import RecordingError
from gaitd_lab.studies.real_data.situations import Values

FILE: Final = "ExperimentalData.mat"
JOINT: Final = "hip_flexion"
COLUMNS: Final = ("stride_index", "stride_ratio", "hip_angle_rad", "hip_torque_nm")
DIGITS: Final = 6


def read(path: Path) -> Values:
    """Read all strides; shape (n, 4) in the order of COLUMNS.

    Raises:
        OSError: the file cannot be opened.
        RecordingError: it has no hip angles and moments where the data set has them.
    """
    try:
        with path.open("rb") as file:
            found = loadmat(file, squeeze_me=True, struct_as_record=False)
    except (ValueError, NotImplementedError, MatReadError) as error:
        raise RecordingError(f"{path}: is no MATLAB file of version 7 or older: {error}") from error
    angle = np.radians(_joint(path, found, "Q.subject1.Qs"))
    moment = _joint(path, found, "Torques.subject1")
    if angle.shape != moment.shape:
        raise RecordingError(
            f"{path}: {JOINT} has angles of shape {angle.shape} and moments of {moment.shape}"
        )
    samples, strides = angle.shape
    ratio = np.arange(samples) / (samples - 1)
    return np.concatenate(
        [
            np.column_stack((np.full(samples, index), ratio, angle[:, index], moment[:, index]))
            for index in range(strides)
        ]
    )


def write(table: Values, path: Path) -> None:
    """Write the strides as `sim_drives/plant/recorded.py` reads them.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for index, *values in table.tolist():
            writer.writerow((int(index), *(f"{value:.{DIGITS}g}" for value in values)))


def _joint(path: Path, found: dict[str, Any], place: str) -> Values:
    """Return the hip's column of a table of all strides, shape (samples, strides)."""
    at: Any = found.get("ExperimentalData")
    for name in place.split("."):
        at = getattr(at, name, None)
    heads = [str(one) for one in np.atleast_1d(getattr(at, "colheaders", ()))]
    values = np.asarray(getattr(at, "all", ()))
    if JOINT not in heads or values.ndim != 3 or values.dtype.kind != "f":
        raise RecordingError(f"{path}: lacks ExperimentalData.{place} with the joint {JOINT}")
    column = values[:, heads.index(JOINT), :].astype(np.float64)
    if not np.all(np.isfinite(column)):
        raise RecordingError(f"{path}: ExperimentalData.{place} has a {JOINT} that is no number")
    return column
