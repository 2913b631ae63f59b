"""Monitor of friction against its calibration: checked in motion, published once.

The numbers are always in the record. Advice to calibrate is an event, and only where no patient is
configured: a patient who pushes with the motion looks like low friction (observer/drift.py).
"""

from daemon.core.state import Core, Leg
from observer.drift import asks_for_calibration, correlation, friction_error, noted
from observer.filter.leg_observer import LegEstimate
from observer.filter.status import Status, Validity

DOUBTFUL = Status.ARTIFICIAL | Status.NEAR_LIMIT | Status.INPUT_SATURATED
"""Status flags under which the estimate shows neither friction nor patient."""


def watch(core: Core, leg: Leg, estimate: LegEstimate, dt_s: float) -> None:
    """Add one cycle's estimate to the drift of both axes; append an event when advice is due."""
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
