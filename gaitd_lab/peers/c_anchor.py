"""Compile `anchor.c` and call it: the observer's step in hand-written C, as a reference."""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.leg_filter import Options, Setup
from observer.filter.leg_memory import START_STD

SOURCE = Path(__file__).with_name("anchor.c")
COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")

Matrix = NDArray[np.float64]


class Estimates(NamedTuple):
    """State after each step (n, 8), NIS (n,), and the final root of the covariance (8, 8)."""

    state: Matrix
    nis: NDArray[np.float64]
    root: Matrix


Run = Callable[[Setup, Matrix, Matrix, float], Estimates]


def build() -> Run | None:
    """Return `run(setup, measured (n, 2), effort (n, 2), dt_s)`; None without a C compiler.

    The run begins at rest at the first measurement, without a correction by it, like the
    observer.
    """
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        return None
    folder = Path(tempfile.mkdtemp(prefix="gaitd-anchor-"))
    try:
        library = folder / "anchor.so"
        subprocess.run([compiler, *FLAGS, "-o", library, SOURCE, "-lm"], check=True)
        loaded = ctypes.CDLL(str(library))
    finally:
        shutil.rmtree(folder)  # once the library is mapped, its file is not needed
    function = loaded.anchor_run
    function.restype = None
    return lambda setup, measured, effort, dt_s: _run(function, setup, measured, effort, dt_s)


def _run(
    function: Callable[..., None],
    setup: Setup,
    measured: Matrix,
    effort: Matrix,
    dt_s: float,
) -> Estimates:
    given = np.asarray(setup)[0]
    options = Options(*given["options"])
    physics = given["leg"], given["hip"], given["slide"], [given["coriolis_share"]]
    model = np.concatenate((*physics, given["process_std"], given["measurement_std"]))
    count = len(measured) - 1
    mean = np.zeros(8)
    mean[:2] = measured[0]
    root = np.diag(START_STD)
    state, nis = np.empty((count, 8)), np.empty(count)
    function(
        *(
            _pointer(model),
            ctypes.c_int(int(options.integrator)),
            ctypes.c_int(int(options.substeps)),
        ),
        *(ctypes.c_int(count), _pointer(measured[1:]), _pointer(effort[1:]), ctypes.c_double(dt_s)),
        *(_pointer(mean), _pointer(root), _pointer(state), _pointer(nis)),
    )
    return Estimates(state, nis, root)


def _pointer(array: Matrix) -> ctypes.c_void_p:
    if not (array.flags.c_contiguous and array.dtype == np.float64):
        raise ValueError("the anchor takes contiguous doubles")
    return array.ctypes.data_as(ctypes.c_void_p)
