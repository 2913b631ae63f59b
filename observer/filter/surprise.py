"""What innovations show that the filter's covariance does not hold, in the published sigma.

Where the model is wrong faster than the patient's noise can follow, such as behind a loose or
elastic transmission that the robot file calls rigid, innovations are several times as large as
their sigma, and the patient's estimate is thrown to and fro. It is then about as wrong as what each
sample corrects of it. So sigma of patient and net holds the mean square of these corrections over
WINDOW_S, from where the mean square of whitened innovations exceeds EXPECTED_MAX, and all of it
from twice that on; or what `transmission.py` hides of net, if that is larger. With a machine
that is as its file says that mean stays below: there sigma is as it was. Samples that are missing
or rejected do not count; the noise of a push covers those.

Such a drive has the friction of its joint wrong for longer: until it is wound up the other way
after a reversal, which the innovations of that moment do not show. But their mean square over
MISFIT_S is too large for white ones, in motion away from reversals, where a wrong friction level
leaves them white. From MISFIT_MAX on, and in full from MISFIT_FULL on, sigma of friction, and so of
the patient, is that of a hip's transmission with a likely compliance (`transmission.py`), if the
file states a stiffer one; net has what is shown already. So it is at first as well, until one to
three seconds of such motion have shown that the transmission is stiff. A drive that is much softer
gives way so slowly that it looks like a patient.

A patient who begins to push surprises the filter as well: sigma is larger for as long, and after a
hard push for some seconds of motion. It is larger, too, where the file states less noise of an
encoder than there is.
Gate, innovations, validity and stops do not read this; the friction monitor and clients do, as
all of sigma. Without parameters that are not sure it is 0.
"""

import math
from typing import Final

from observer.filter.leg_memory import MISFIT_FULL, LegMemory
from observer.jit import inline

WINDOW_S: Final = 0.1
EXPECTED_MAX: Final = 2.0
"""The mean square of white innovations is 1, and over WINDOW_S hardly ever twice that."""
ONWARD_MIN_S: Final = 0.2
"""Innovations count as misfit from this long after a rest or a reversal on."""
MISFIT_S: Final = 3.0
MISFIT_MAX: Final = 1.2
"""The mean square of 600 white innovations, which is what MISFIT_S weighs, plus 3.5 sigma."""


@inline
def follow_surprise(m: LegMemory, dt_s: float) -> None:
    """Advance the means of both axes, and the variance that they add, by a finished step."""
    share, of_misfit = 1.0 - math.exp(-dt_s / WINDOW_S), 1.0 - math.exp(-dt_s / MISFIT_S)
    for axis in range(2):
        if m.predicted[axis] == 0.0:
            whitened, correction = m.whitened[axis], m.correction[axis]
            m.surprise[axis] += share * (whitened * whitened - m.surprise[axis])
            if math.fabs(_follow_way(m, axis, dt_s)) > ONWARD_MIN_S:
                m.misfit[axis] += of_misfit * (whitened * whitened - m.misfit[axis])
            m.corrected[axis] += share * (correction * correction - m.corrected[axis])
        beyond = m.surprise[axis] / EXPECTED_MAX - 1.0
        m.shown_net[axis] = min(max(beyond, 0.0), 1.0) * m.corrected[axis]


@inline
def _follow_way(m: LegMemory, axis: int, dt_s: float) -> float:
    """Advance the time for which an axis moves the same way, and return it: with the way's sign."""
    onward_s, velocity = m.onward_s[axis], m.mean[2 + axis]
    if m.rest_s[axis] > 0.0:
        m.onward_s[axis] = 0.0
    elif velocity > 0.0:
        m.onward_s[axis] = max(onward_s, 0.0) + dt_s
    else:
        m.onward_s[axis] = min(onward_s, 0.0) - dt_s
    return m.onward_s[axis]


@inline
def doubt_of_stiffness(m: LegMemory) -> float:
    """Share of the hip's likely compliance (`transmission.py`) that its misfit allows, 0 to 1."""
    return min(max((m.misfit[0] - MISFIT_MAX) / (MISFIT_FULL - MISFIT_MAX), 0.0), 1.0)
