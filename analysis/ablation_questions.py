"""Questions of the ablation, and the cells that answer each: one table and one figure each."""

from typing import Final, NamedTuple

from analysis.ablation import GLITCHES, JITTER_NOMINAL, JITTER_TRUE, LATE, RIPPLED
from analysis.ablation_choices import SHIPPED

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
    """One question, and the cells of the ablation that answer it."""

    key: str
    """Name of its figure's file."""
    title: str
    text: str
    """The finding and its cost; a paragraph."""
    situations: tuple[str, ...]
    choices: tuple[str, ...]
    measure: str = "patient"
    """Field of `ablation.Errors`."""
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
        "Without it a passive patient seems to push at the hip in every swing, four times as hard "
        "at twice the cadence, and 3 sigma no longer cover the truth. It needs no extra computing "
        "time: the two-circle constraint gives it in closed form.",
        _gaits("paper", "0.25 0.5", "passive active"),
        (SHIPPED, "without Coriolis"),
    ),
    Question(
        "rest",
        "Velocity-gated noise: at rest, changes go to friction",
        "A minute at rest shows the false activity that the gate removes. The gate is for a joint "
        "that sticks (paper_sticking): without it a load that friction holds counts as a patient, "
        "and 3 sigma do not cover that. The net effort is as good as without the gate. The price: "
        "until the joint has moved, a patient who pushes is estimated with a large sigma. Bristles "
        "(lugre) yield under load, which counts as motion: at rest the gate gains nothing on them, "
        "and 3 sigma of the hip's patient cover too little, with or without it. The paper's noise "
        "is best here only with a passive patient; the section on the paper's tuning shows an "
        "active one.",
        (REST, EXCITED, *_gaits("paper_sticking lugre", "0.25", "passive")),
        (SHIPPED, "not gated at rest", "paper's noise"),
        measure="patient_at_rest",
        measured="patient's effort at rest",
    ),
    Question(
        "sticking",
        "The same after the joint moves again",
        "What was assigned to the wrong state at rest is an error in the motion that follows: a "
        "large one where a joint really sticks, and the gate removes most of it at the hip. A "
        "joint that creeps, as with the paper's law, counts as moving: there the gate costs next "
        "to nothing.",
        (
            EXCITED,
            *_gaits("paper", "0.25", "passive active"),
            *_gaits("paper_sticking lugre", "0.25", "passive"),
        ),
        (SHIPPED, "not gated at rest", "paper's noise"),
    ),
    Question(
        "agility",
        "Patient's noise that rises while the innovations have a biased mean",
        "A patient who pushes ever harder is no random walk. With a ratio of 3 the estimate lags "
        "less behind an active one, at 0.5 Hz by a third, and on the matched plant its 3 sigma "
        "cover the truth. A passive one costs nothing: the innovations have no bias. Against LuGre "
        "the slide gains nothing, since its error is of structure, not of lag.",
        (*_gaits("paper lugre", "0.25 0.5", "active"), *_gaits("paper", "0.5", "passive")),
        (SHIPPED, "noise never rises"),
    ),
    Question(
        "integrator",
        "Integrator: RK4 with two substeps, or semi-implicit",
        "Friction is stiff, and the semi-implicit step averages it over 10 ms, most of all where "
        "it changes fast; two substeps halve that (see the column of friction). Explicit Euler is "
        "not in this table because it is refused: at 10 ms it is unstable with real friction, and "
        "a configuration that names it does not load.",
        _gaits("paper", "0.25 0.5", "passive active"),
        (SHIPPED, "semi-implicit x2", "semi-implicit x1"),
    ),
    Question(
        "friction",
        "Friction: in the paper's low-pass, viscous part outside, or none",
        "Each model is right for its own plant: the paper's law delays viscous friction, LuGre's "
        "bristles do not. Against LuGre at 0.5 Hz the option `viscous_outside` halves the error "
        "at the slide; against the paper's law it costs several newtons. It is an option because "
        "only the machine can say which. Without a friction model all friction counts as patient.",
        _gaits("paper lugre", "0.25 0.5", "passive"),
        (SHIPPED, "viscous outside", "no friction model"),
    ),
    Question(
        "paper",
        "The paper's tuning: friction's noise far above the patient's",
        "It has the smallest error while the patient is passive, because the patient's state "
        "hardly changes: half of an active patient's effort is estimated as friction. The paper's "
        "observer drops the Coriolis torque as well.",
        _gaits("paper", "0.25 0.5", "passive active"),
        (SHIPPED, "paper's noise", "paper's observer"),
    ),
    Question(
        "time",
        "Sample times: true, nominal, or nominal with the jitter configured",
        "Samples 1 ms (one sigma) off the grid. With their true times nothing is lost. With the "
        "grid's times the filter rejects samples, restarts and reports itself inconsistent by its "
        "NIS: nearly no sample is OK. With the jitter configured (`sample_jitter_us`) it runs "
        "without restarts and its sigma is consistent again, at up to twice the error of the "
        "patient and three to six times that of velocity; with a configured jitter that the true "
        "times already remove, the errors rise without a benefit.",
        (BASIS, JITTER_TRUE, JITTER_NOMINAL),
        (SHIPPED, "jitter configured"),
    ),
    Question(
        "effort",
        "Efforts: a cycle late, or with a ripple",
        "Efforts that act a cycle later than their rows double the slide's error, and NIS hardly "
        "shows it; with `effort_delay_ms = 10` the result is that of the clean recording. With a "
        "configured delay that does not exist, the error is as large. Ripple of 0.1 N·m and 8 N on "
        "each sample makes sigma too small; with the ripple configured, it covers again. In motion "
        "the error stays, because the ripple itself is unknown; with a configured ripple that does "
        "not exist, the slide's error more than doubles, because the samples of effort get less "
        "weight. Both options are off unless the machine needs them.",
        (BASIS, LATE, RIPPLED),
        (SHIPPED, "delay configured", "ripple configured"),
    ),
    Question(
        "glitches",
        "Glitches of the encoders: rejected, or accepted",
        "A wrong sample of 0.01 to 0.3 rad (or m) each second. With `gate_nis = 60` they have no "
        "effect. With the gate at 1000 some pass; the estimate is wrong, and its status shows it: "
        "nearly no sample is OK.",
        (BASIS, GLITCHES),
        (SHIPPED, "glitch gate open"),
    ),
)

WRONG: Final = (
    Question(
        "parameters",
        "Parameters that are wrong",
        "Friction levels 20 % off are an error of that friction, whatever the filter does; a leg "
        "10 % too heavy is its weight at the hip. At 0.25 Hz neither shows in NIS, and 3 sigma "
        "of the patient cover next to nothing: sigma describes noise, not a wrong number "
        "in the robot file. Net suffers little from wrong friction, and fully from a wrong leg. "
        "Hence calibration, the friction monitor and the empty run.",
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
        "Nothing in the tuning is for 80 kg and 6 N·m: with the right numbers the errors stay "
        "near where they were. Halved and doubled, Coulomb friction is 3 and 12 N·m, 32 and 130 "
        "N. In motion the gate at rest costs next to nothing on any of them.",
        (BASIS, *OTHER_PLANTS),
        (SHIPPED, "not gated at rest"),
    ),
)

REASONS: Final = (
    (JITTER_NOMINAL, "the jitter is not configured; with it, sigma covers"),
    (LATE, "the delay is not configured; with it, sigma covers"),
    (RIPPLED, "the ripple is not configured; with it, sigma covers"),
    (
        "lugre",
        "bristles are not the observer's friction: an error of structure, which no noise "
        "describes; most of it comes within 200 ms of a reversal, and at 0.5 Hz from viscous "
        "friction, which `viscous_outside` sets right at the slide",
    ),
    (
        "paper_sticking",
        "a joint that sticks at a reversal breaks away within a sample, faster than T1 of the "
        "model lets friction change; most samples that are not covered lie within 100 ms of that, "
        "and at 0.5 Hz those at rest are less than a second in each draw",
    ),
)
"""Reason why 3 sigma do not cover, by the beginning of a situation's name."""
