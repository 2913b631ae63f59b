"""sin, cos, expm1 and tanh without branches, so that loops over sigma points become vector code.

A loop with a call to the C library is not vectorised. These functions are range reduction and a
Taylor series long enough for double precision; the tests hold them within two units in the last
place of the C library's. Arguments must be finite; callers ensure that.
"""

import math
from typing import Final

import numpy as np

from observer.jit import inline

ROUND: Final = 6755399441055744.0
"""1.5 * 2**52: adding it rounds to an integer, which is then in the low bits."""
LN2_HIGH: Final = 6.93147180369123816490e-01
LN2_LOW: Final = 1.90821492927058770002e-10
"""log 2 in two parts; products of the high part with small integers are exact."""
HALF_PI_HIGH: Final = 1.57079632673412561417
HALF_PI_MIDDLE: Final = 6.07710050630396597660e-11
HALF_PI_LOW: Final = 2.02226624879595063154e-21
"""Half pi in three parts, with exact products as for log 2."""
LOG2_E: Final = 1.0 / math.log(2.0)
TWO_OVER_PI: Final = 2.0 / math.pi
SMALLEST_EXPONENT: Final = -700.0
"""Below it exp is under 1e-304, and expm1 is -1."""
EXPONENT_BIAS: Final = 1023
MANTISSA_BITS: Final = 52


@inline
def expm1_of_negative(x: float) -> float:
    """exp(x) - 1 for x <= 0, exact to the last place also for tiny x, -1 for very negative x."""
    x = max(x, SMALLEST_EXPONENT)
    rounded = x * LOG2_E + ROUND
    power = rounded - ROUND
    r = (x - power * LN2_HIGH) - power * LN2_LOW
    # exp(r) - 1 - r = r^2 (1/2 + r/6 + ...), |r| <= log(2) / 2
    series = 1.0 / 479001600.0 + r * (1.0 / 6227020800.0)
    series = 1.0 / 39916800.0 + r * series
    series = 1.0 / 3628800.0 + r * series
    series = 1.0 / 362880.0 + r * series
    series = 1.0 / 40320.0 + r * series
    series = 1.0 / 5040.0 + r * series
    series = 1.0 / 720.0 + r * series
    series = 1.0 / 120.0 + r * series
    series = 1.0 / 24.0 + r * series
    series = 1.0 / 6.0 + r * series
    series = 0.5 + r * series
    small = r + r * r * series
    bits = (np.float64(rounded).view(np.int64) + EXPONENT_BIAS) << MANTISSA_BITS
    scale = np.int64(bits).view(np.float64)
    return scale * small + (scale - 1.0)


@inline
def tanh(x: float) -> float:
    """Hyperbolic tangent, exactly odd."""
    decay = expm1_of_negative(-2.0 * abs(x))
    return math.copysign(decay / (2.0 + decay), x)


@inline
def cos_sin(angle_rad: float) -> tuple[float, float]:
    """Cosine and sine of an angle of at most some thousand turns."""
    rounded = angle_rad * TWO_OVER_PI + ROUND
    turns = rounded - ROUND
    r = angle_rad - turns * HALF_PI_HIGH
    r = (r - turns * HALF_PI_MIDDLE) - turns * HALF_PI_LOW
    z = r * r
    odd = -1.0 / 1307674368000.0 + z * (1.0 / 355687428096000.0)
    odd = 1.0 / 6227020800.0 + z * odd
    odd = -1.0 / 39916800.0 + z * odd
    odd = 1.0 / 362880.0 + z * odd
    odd = -1.0 / 5040.0 + z * odd
    odd = 1.0 / 120.0 + z * odd
    odd = -1.0 / 6.0 + z * odd
    sine = r + r * z * odd
    even = -1.0 / 87178291200.0 + z * (1.0 / 20922789888000.0)
    even = 1.0 / 479001600.0 + z * even
    even = -1.0 / 3628800.0 + z * even
    even = 1.0 / 40320.0 + z * even
    even = -1.0 / 720.0 + z * even
    even = 1.0 / 24.0 + z * even
    even = -0.5 + z * even
    cosine = 1.0 + z * even
    quadrant = np.float64(rounded).view(np.int64)
    swapped = (quadrant & 1) == 1
    first = sine if swapped else cosine
    second = cosine if swapped else sine
    first = -first if ((quadrant + 1) & 2) == 2 else first
    second = -second if (quadrant & 2) == 2 else second
    return first, second
