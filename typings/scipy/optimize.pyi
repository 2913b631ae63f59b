from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

class OptimizeResult:
    x: NDArray[np.float64]
    fun: float

class LeastSquaresResult:
    x: NDArray[np.float64]
    cost: float
    fun: NDArray[np.float64]
    jac: NDArray[np.float64]

class RootResults:
    root: float

def least_squares(
    fun: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    x0: ArrayLike,
    *,
    diff_step: float,
    x_scale: float,
    max_nfev: int,
) -> LeastSquaresResult: ...
def minimize(
    fun: Callable[..., float],
    x0: ArrayLike,
    *,
    method: str,
    jac: Callable[..., Any] = ...,
    hess: Callable[..., Any] = ...,
    callback: Callable[..., None] = ...,
    options: Mapping[str, Any] = ...,
) -> OptimizeResult: ...
def minimize_scalar(
    fun: Callable[[float], float], *, bounds: tuple[float, float], method: str
) -> OptimizeResult: ...
def root_scalar(
    f: Callable[[float], float], *, bracket: tuple[float, float], xtol: float
) -> RootResults: ...
