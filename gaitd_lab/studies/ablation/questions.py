"""Questions of the ablation, and the cells that answer each: one table and one figure each.

docs/evidence/ablation.md has the answers.
"""

from typing import Final, NamedTuple

from gaitd_lab.studies.ablation.choices import SHIPPED
from gaitd_lab.studies.ablation.errors import GLITCHES, JITTER_NOMINAL, JITTER_TRUE, LATE, RIPPLED

REST: Final = "at rest"
EXCITED: Final = "scenario paper, empty"
BASIS: Final = "paper, 0.25 Hz, active"
"""The trial that is disturbed, and replayed with wrong parameters."""
OTHER_PLANTS: Final = (
    "friction halved",
    "friction doubled",
    "patient of 50 kg",
    "patient of 110 kg",
)


class Question(NamedTuple):
    """One question, and the cells that answer it."""

    key: str
    """Name of its figure's file."""
    title: str
    situations: tuple[str, ...]
    choices: tuple[str, ...]
    measure: str = "patient"
    """Field of `errors.Errors`."""
    measured: str = "patient's effort while moving"


def _gaits(laws: str, cadences: str, programmes: str) -> tuple[str, ...]:
    return tuple(
        f"{law}, {cadence} Hz, {programme}"
        for law in laws.split()
        for cadence in cadences.split()
        for programme in programmes.split()
    )


QUESTIONS: Final = (
    Question(
        "coriolis",
        "Coriolis torque: full, or dropped as in the paper",
        _gaits("paper", "0.25 0.5", "passive active"),
        (SHIPPED, "without Coriolis"),
    ),
    Question(
        "rest",
        "Velocity-gated noise: at rest, changes go to friction",
        (REST, EXCITED, *_gaits("paper_sticking lugre", "0.25", "passive")),
        (SHIPPED, "not gated at rest", "paper's noise"),
        measure="patient_at_rest",
        measured="patient's effort at rest",
    ),
    Question(
        "sticking",
        "The same after the joint moves again",
        (
            EXCITED,
            *_gaits("paper", "0.25", "passive active"),
            *_gaits("paper_sticking lugre", "0.25", "passive"),
        ),
        (SHIPPED, "not gated at rest", "paper's noise"),
    ),
    Question(
        "agility",
        "Patient's noise that follows how much the innovations agree",
        (*_gaits("paper lugre", "0.25 0.5", "active"), *_gaits("paper", "0.5", "passive")),
        (SHIPPED, "noise never rises"),
    ),
    Question(
        "integrator",
        "Integrator: RK4 with two substeps, or semi-implicit",
        _gaits("paper", "0.25 0.5", "passive active"),
        (SHIPPED, "semi-implicit x2", "semi-implicit x1"),
    ),
    Question(
        "friction",
        "Friction: in the paper's low-pass, viscous part outside, or none",
        _gaits("paper lugre", "0.25 0.5", "passive"),
        (SHIPPED, "viscous outside", "no friction model"),
    ),
    Question(
        "paper",
        "The paper's tuning: friction's noise far above the patient's",
        _gaits("paper", "0.25 0.5", "passive active"),
        (SHIPPED, "paper's noise", "paper's observer"),
    ),
    Question(
        "time",
        "Sample times: true, nominal, or nominal with the jitter configured",
        (BASIS, JITTER_TRUE, JITTER_NOMINAL),
        (SHIPPED, "jitter configured"),
    ),
    Question(
        "effort",
        "Efforts: a cycle late, or with a ripple",
        (BASIS, LATE, RIPPLED),
        (SHIPPED, "delay configured", "ripple configured"),
    ),
    Question(
        "glitches",
        "Glitches of the encoders: rejected, or accepted",
        (BASIS, GLITCHES),
        (SHIPPED, "glitch gate open"),
    ),
    Question(
        "parameters",
        "Parameters that are wrong",
        (BASIS, *_gaits("paper", "0.5", "passive")),
        (
            SHIPPED,
            "friction set 20 % low",
            "friction set 20 % high",
            "leg set 10 % light",
            "leg set 10 % heavy",
        ),
    ),
    Question(
        "plants",
        "Other machines and patients, with the robot file right",
        (BASIS, *OTHER_PLANTS),
        (SHIPPED, "not gated at rest"),
    ),
)
