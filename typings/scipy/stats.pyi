import numpy as np
from numpy.typing import ArrayLike, NDArray

class _Distribution:
    def ppf(self, q: ArrayLike, df: ArrayLike) -> NDArray[np.float64]: ...

chi2: _Distribution
t: _Distribution
