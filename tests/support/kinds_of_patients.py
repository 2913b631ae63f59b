"""The kinds of patients that the reference controller is judged by, each made anew by a call."""

from typing import Final

import numpy as np

from gaitd_lab.patients import (
    DT_S,
    Gait,
    Late,
    Slacking,
    of_ability,
    resisting,
    spastic,
    trembling,
    weak,
)

HIP_BAND: Final = np.radians(2.0)
SLIDE_BAND_M: Final = 0.03


def with_strength(strength):
    """Able, as far as the strength of each moment allows."""
    return lambda gait: np.multiply(strength(gait), of_ability(1.0)(gait))


def resisting_by_spring(gait: Gait) -> np.ndarray:
    """Draws the leg to the middle of the gait."""
    return -np.array([30.0, 150.0]) * (gait.pose - np.array([0.244, 0.5905]))


class Lazy:
    """Able, with the strength that the error of the last second asks for."""

    def __init__(self) -> None:
        self._strength = 1.0

    def __call__(self, gait: Gait) -> np.ndarray:
        """Effort now."""
        asked = min(float(np.max(np.abs(gait.error) / (HIP_BAND, SLIDE_BAND_M))), 1.0)
        self._strength += DT_S * (asked - self._strength)
        return of_ability(self._strength)(gait)


def tires_and_recovers(gait: Gait) -> float:
    """Loses its strength from 12 to 18 s, and has it again from 40 to 42 s."""
    lost = (gait.time_s - 12.0) / 6.0 if gait.time_s < 40.0 else 1.0 - (gait.time_s - 40.0) / 2.0
    return 1.0 - min(max(lost, 0.0), 1.0)


STEADY: Final = {
    "passive": lambda: of_ability(0.0),
    "half": lambda: of_ability(0.5),
    "all": lambda: of_ability(1.0),
    "1.4": lambda: of_ability(1.4),
    "late": lambda: Late(of_ability(1.0)),
    "lazy": Lazy,
    "resisting": lambda: resisting,
    "resisting by spring": lambda: resisting_by_spring,
    "resisting by half the need": lambda: lambda gait: -0.5 * gait.need,
    "spasms": lambda: spastic,
    "tremor": lambda: trembling,
    "weak at 0.1 to 0.3": lambda: weak(of_ability(1.0), 0.1, 0.3),
    "weak at 0.55 to 0.75": lambda: weak(of_ability(1.0), 0.55, 0.75),
    "hip only": lambda: with_strength(lambda _: (1.0, 0.0)),
    "slide only": lambda: with_strength(lambda _: (0.0, 1.0)),
}
PATIENTS: Final = STEADY | {
    "slacking": Slacking,
    "tiring and recovering": lambda: with_strength(tires_and_recovers),
}
