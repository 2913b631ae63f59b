"""Whether friction is still what the calibration says: watched in motion, told once.

The numbers are always in the record. Advice to calibrate is an event, and only where no patient is
configured: one who pushes with the motion looks like friction that is too low (observer/drift.py).
"""

from daemon.core.state import Core, Leg
from observer.drift import asks_for_calibration, correlation, friction_error, noted
from observer.filter.leg_observer import LegEstimate
from observer.filter.status import Status, Validity

DOUBTFUL = Status.ARTIFICIAL | Status.NEAR_LIMIT | Status.INPUT_SATURATED
"""What is in the estimate then is neither friction nor patient."""


def watch(core: Core, leg: Leg, estimate: LegEstimate, dt_s: float) -> None:
    """Take one cycle's estimate into the drift of both axes; an event when advice is due."""
    if estimate.status & DOUBTFUL:
        return
    for index, axis in enumerate(leg.axes):
        if estimate.validity[index] is not Validity.OK:
            continue
        law = leg.friction[index]
        speed, patient = estimate.state[2 + index], estimate.state[6 + index]
        axis.drift = noted(axis.drift, law, speed, patient, dt_s)
        advised = not core.config.patient_configured and asks_for_calibration(axis.drift, law)
        if advised and not axis.calibration_advised:
            core.events.append(
                f"{axis.name}: friction is {friction_error(axis.drift):+.3g} from its law "
                f"(correlation {correlation(axis.drift):+.2f}): calibrate"
            )
        axis.calibration_advised = advised
