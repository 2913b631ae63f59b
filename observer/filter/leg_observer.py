"""The observer of one leg: samples in, estimates out.

`LegObserver` holds what one leg's filter needs between cycles; `leg_filter.advance` does the work.
Observers share no state.

Conventions: position (hip angle rad, slide position m) is what was measured at this cycle's SYNC;
effort (hip torque N m, slide force N) is the effort of the drives since the previous SYNC; `dt_s`
is the true time between the two. The patient's effort is the effort exerted on the joint minus the
effort given to the observer, positive along the positive axis. net = patient - friction is always
observable, the split only in motion.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.considered import NOTHING_KNOWN, Known, Variant, table_of
from observer.filter.leg_filter import (
    OUT_COVARIANCE,
    OUT_INNOVATION,
    OUT_NET,
    OUT_NET_STD,
    OUT_NIS,
    OUT_PASSIVE,
    OUT_SIZE,
    OUT_STD,
    SETUP_LAYOUT,
    Options,
    Setup,
    advance,
    begin_at_rest,
    constants_of,
)
from observer.filter.leg_memory import EFFORTS, LegMemory, may_start, new_memory
from observer.filter.leg_model import STEP_S, Integrator, substeps_needed
from observer.filter.states import STATE_COUNT
from observer.filter.status import START_RATIO_MIN, Status, Validity
from observer.jit import kernel
from observer.mechanism.friction import (
    EVERYWHERE,
    FrictionParameters,
    OverPosition,
    levels_of,
    smallest_stribeck,
)
from observer.mechanism.mechanism import WorkspaceError, smallest_inertia
from observer.mechanism.parameters import LegParameters

Vector = NDArray[np.float64]
Pair = Sequence[float] | Vector


class TuningError(ValueError):
    """Parameters that give no valid estimate; names the parameter and the allowed range."""


class PoseError(WorkspaceError):
    """A measured pose that is impossible for a leg: wrong offset, wrong geometry, wrong branch."""


class ObserverTuning(NamedTuple):
    """Tuning parameters (observer.md 3.1), besides the physics."""

    process_std: tuple[float, float, float, float, float, float, float, float]
    """Process noise per 10 ms step, in the order and units of `states.STATE_NAMES`."""
    measurement_std: tuple[float, float]
    """Encoder noise: rad, m."""
    coriolis: bool = True
    velocity_gated: bool = False
    """At rest, changes go to friction, the patient stays constant, and the split is uncertain."""
    integrator: Integrator = Integrator.RK4
    substeps: int = 2
    gate_nis: float = 60.0
    patient_noise_max_ratio: float = 1.0
    """Largest factor on the patient's process noise while the innovations are biased."""
    viscous_outside: bool = False
    """Viscous friction acts at once, as with bristles; else through eq. (11)'s low-pass."""
    effort_delay_ms: float = 0.0
    """Delay of the effort relative to the step that it is given for."""
    sample_jitter_us: float = 0.0
    """Standard deviation of a sample's true time about the given one."""
    ripple: tuple[float, float] = (0.0, 0.0)
    """Standard deviation of the sampled effort about its mean over the step: N m, N."""
    law: tuple[float, float] = (0.0, 0.0)
    """Standard deviation of the friction law near reversals (`law_variance`): N m, N."""
    compliance: tuple[float, float] = (0.0, 0.0)
    """How far the transmissions give way (`transmission.py`): rad/(N m), m/N; 0: rigid."""
    backlash: tuple[float, float] = (0.0, 0.0)
    """How far they turn without effort: rad, m."""
    effort_offset: tuple[float, float] = (0.0, 0.0)
    """What the drives show at no effort: N m, N."""
    friction_over_position: tuple[OverPosition, OverPosition] = (EVERYWHERE, EVERYWHERE)
    """How friction rises along the axes."""


DEFAULT_TUNING: Final = ObserverTuning(
    process_std=(1e-6, 1e-6, 1e-3, 5e-4, 0.1, 1.0, 0.1, 1.0), measurement_std=(5.8e-5, 2.5e-5)
)


LEVELS: Final = tuple(Validity)
EFFORT_DELAY_MAX_MS: Final = 1e3 * STEP_S * (EFFORTS - 1)
CALLER_BITS: Final = (
    Status.LATE,
    Status.UNREFERENCED,
    Status.ARTIFICIAL,
    Status.INPUT_SATURATED,
    Status.NEAR_LIMIT,
)
"""Status bits that only the caller of `step` can know, in the order of its arguments."""


class LegEstimate(NamedTuple):
    """Estimate of one leg after one cycle. Numbers of a BAD axis must not be used.

    `innovation` and `nis` are NaN for missing measurements; before the first pose all numbers are.
    """

    state: tuple[float, ...]
    """State in the order and units of `states.STATE_NAMES`."""
    std: tuple[float, ...]
    covariance: tuple[float, ...]
    """Lower triangle, row by row: 36 values."""
    innovation: tuple[float, float]
    """Measured minus predicted: rad, m."""
    nis: float
    """Innovation squared over its covariance; 2 on average when two axes are measured."""
    mean_nis: float
    """Mean over about a hundred cycles, for two measurements each; 95 of 100 are in 1.72..2.28."""
    net: tuple[float, float]
    """Patient minus friction: N m, N."""
    net_std: tuple[float, float]
    validity: tuple[Validity, Validity]
    """Validity of hip and slide."""
    status: Status
    passive: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """Part of friction and patient, hip before slide, that a passive baseline explains.

    It is taken off what is published. `state` and `net` are the filter's own, and contain it; sigma
    of friction, patient and net is that of what is published.
    """


class LegObserver:
    """Estimates state, friction and patient activity of one leg, cycle by cycle."""

    def __init__(
        self,
        leg: LegParameters,
        hip: FrictionParameters,
        slide: FrictionParameters,
        tuning: ObserverTuning,
        considered: Sequence[Variant] = (),
        *,
        calibrated: bool = True,
    ) -> None:
        """Create an observer that starts at the first pose it is given.

        Args:
            leg: mechanism, with or without a patient's leg in it.
            hip: friction of the hip.
            slide: friction of the slide.
            tuning: noise, integrator, gate.
            considered: the physics with each parameter that is not sure a standard deviation
                larger; sigma as published holds them.
            calibrated: True if the friction parameters were measured on this machine.

        Raises:
            TuningError: noise that is not positive, friction whose hump turns over, or an
                integrator that is unstable with it.
        """
        check_tuning(leg, hip, slide, tuning)
        self._setup = setup_of(leg, hip, slide, tuning, considered)
        self._known = NOTHING_KNOWN
        self._always = Status(0) if calibrated else Status.UNCALIBRATED
        self._memory, self._points = new_memory()
        self._mean_nis: Vector = self._memory["nis_mean"]
        self._out = np.zeros(OUT_SIZE)

    @property
    def setup(self) -> Setup:
        """Parameters as the kernels take them."""
        return self._setup

    @property
    def known(self) -> Known:
        """What the baseline in force says."""
        return self._known

    def take_baseline(self, known: Known) -> None:
        """From the next cycle on, publish what is left beyond this; NOTHING_KNOWN: all."""
        self._known = known
        self._setup = with_baseline(self._setup, known)

    def reset(self, position: Pair) -> None:
        """Start at a measured pose, at rest.

        Args:
            position: hip angle rad, slide position m.

        Raises:
            PoseError: impossible pose. The observer is unchanged.
        """
        hip, slide = _number(position[0]), _number(position[1])
        if not (math.isfinite(hip) and math.isfinite(slide)):
            raise PoseError(f"hip {position[0]} rad, slide {position[1]} m is not finite")
        if not begin_at(self.setup, self._memory, hip, slide):
            raise PoseError(
                f"hip {hip:.4f} rad, slide {slide:.4f} m: shank and shoe do not reach each other, "
                f"are within {START_RATIO_MIN} of the singularity, or the knee is bent backwards; "
                "check offsets and geometry"
            )

    def step(
        self,
        position: Pair,
        effort: Pair,
        dt_s: float,
        *,
        effort_std: tuple[float, float] = (0.0, 0.0),
        late: bool = False,
        unreferenced: bool = False,
        artificial: bool = False,
        input_saturated: bool = False,
        near_limit: bool = False,
    ) -> LegEstimate:
        """Process one cycle.

        Args:
            position: hip angle rad and slide position m, measured now; None or NaN if missing.
            effort: hip torque N m and slide force N that acted since the previous cycle.
            dt_s: time since the previous cycle, s.
            effort_std: standard deviation of `effort`: the ripple of this step if it exceeds the
                tuning's; also added to the uncertainty of patient and net, because it may be biased
                for long.
            late: the sample came after its cycle.
            unreferenced: an axis is not referenced.
            artificial: an artificial disturbance is in `effort`.
            input_saturated: a drive exerted less than requested.
            near_limit: a joint is at its end stop.

        Never fails: unusable samples are replaced by prediction, which `status` shows.
        """
        bits = self._always
        if late or unreferenced or artificial or input_saturated or near_limit:
            bits |= _caller_bits(late, unreferenced, artificial, input_saturated, near_limit)
        status, level_hip, level_slide = advance(
            self.setup,
            self._memory,
            self._points,
            (_number(position[0]), _number(position[1])),
            (_number(effort[0]), _number(effort[1])),
            effort_std,
            float(dt_s),
            bits.value,
            self._out,
        )
        if effort_std != (0.0, 0.0):
            _widen(self._out, effort_std)
        values = self._out.tolist()
        return LegEstimate(
            tuple(values[:OUT_STD]),
            tuple(values[OUT_STD:OUT_COVARIANCE]),
            tuple(values[OUT_COVARIANCE:OUT_INNOVATION]),
            (values[OUT_INNOVATION], values[OUT_INNOVATION + 1]),
            values[OUT_NIS],
            float(self._mean_nis[0]),
            (values[OUT_NET], values[OUT_NET + 1]),
            (values[OUT_NET_STD], values[OUT_NET_STD + 1]),
            (LEVELS[level_hip], LEVELS[level_slide]),
            Status(status),
            tuple(values[OUT_PASSIVE:]),
        )

    @property
    def buffers(self) -> tuple[Any, Vector]:
        """Memory and points after the last cycle, for `smoother.store`."""
        return self._memory, self._points


def setup_of(
    leg: LegParameters,
    hip: FrictionParameters,
    slide: FrictionParameters,
    tuning: ObserverTuning,
    considered: Sequence[Variant] = (),
) -> Setup:
    """Parameters as the kernels take them."""
    options = Options(
        gate_nis=float(tuning.gate_nis),
        velocity_gated=float(tuning.velocity_gated),
        integrator=float(tuning.integrator),
        substeps=float(tuning.substeps),
        patient_noise_max_ratio=float(tuning.patient_noise_max_ratio),
        viscous_outside=float(tuning.viscous_outside),
        effort_delay_cycles=1e-3 * tuning.effort_delay_ms / STEP_S,
        sample_jitter_s=1e-6 * tuning.sample_jitter_us,
        ripple_hip=float(tuning.ripple[0]),
        ripple_slide=float(tuning.ripple[1]),
        law_hip=float(tuning.law[0]),
        law_slide=float(tuning.law[1]),
        compliance_hip=float(tuning.compliance[0]),
        compliance_slide=float(tuning.compliance[1]),
        backlash_hip=float(tuning.backlash[0]),
        backlash_slide=float(tuning.backlash[1]),
        offset_hip=float(tuning.effort_offset[0]),
        offset_slide=float(tuning.effort_offset[1]),
        friction_slope_hip=float(tuning.friction_over_position[0].slope),
        friction_middle_hip=float(tuning.friction_over_position[0].middle),
        friction_slope_slide=float(tuning.friction_over_position[1].slope),
        friction_middle_slide=float(tuning.friction_over_position[1].middle),
    )
    noise = tuning.process_std, tuning.measurement_std
    unsure = float(len(considered)), table_of(Variant(leg, hip, slide), considered)
    known = (0.0, *NOTHING_KNOWN[1:])
    values = (leg, hip, slide, float(tuning.coriolis), options, *noise, *unsure, *known)
    setup: Any = np.array([values], SETUP_LAYOUT)
    setup.setflags(write=False)
    return setup


def with_baseline(setup_of: Setup, known: Known) -> Setup:
    """The same parameters with another baseline."""
    setup: Any = np.array(setup_of)
    setup["baseline_taken"] = float(known.taken)
    setup["theta"], setup["root"], setup["kept_std"] = known.theta, known.root, known.kept_std
    setup.setflags(write=False)
    return setup


def _widen(out: Vector, effort_std: tuple[float, float]) -> None:
    """Add an unknown effort to the uncertainty of patient and net."""
    for axis, std in enumerate(effort_std):
        if std == 0.0:
            continue
        patient = 6 + axis
        variance = OUT_COVARIANCE + patient * (patient + 1) // 2 + patient
        out[variance] += std * std
        out[OUT_STD + patient] = math.hypot(out[OUT_STD + patient], std)
        out[OUT_NET_STD + axis] = math.hypot(out[OUT_NET_STD + axis], std)


def check_tuning(
    leg: LegParameters,
    hip: FrictionParameters,
    slide: FrictionParameters,
    tuning: ObserverTuning,
) -> None:
    """Refuse parameters that cannot give consistent estimates.

    Raises:
        TuningError: names the parameter, its value and the allowed range.
    """
    for name, values, count in (
        ("process_std", tuning.process_std, STATE_COUNT),
        ("measurement_std", tuning.measurement_std, 2),
        ("gate_nis", (tuning.gate_nis,), 1),
    ):
        if len(values) != count or not all(math.isfinite(x) and x > 0.0 for x in values):
            raise TuningError(f"{name} = {values}: must be {count} positive numbers")
    for name, value, least, most in (
        ("patient_noise_max_ratio", tuning.patient_noise_max_ratio, 1.0, math.inf),
        ("effort_delay_ms", tuning.effort_delay_ms, 0.0, EFFORT_DELAY_MAX_MS),
        ("sample_jitter_us", tuning.sample_jitter_us, 0.0, math.inf),
        ("ripple of the hip", tuning.ripple[0], 0.0, math.inf),
        ("ripple of the slide", tuning.ripple[1], 0.0, math.inf),
        ("law of the hip", tuning.law[0], 0.0, math.inf),
        ("law of the slide", tuning.law[1], 0.0, math.inf),
        ("compliance of the hip", tuning.compliance[0], 0.0, math.inf),
        ("compliance of the slide", tuning.compliance[1], 0.0, math.inf),
        ("backlash of the hip", tuning.backlash[0], 0.0, math.inf),
        ("backlash of the slide", tuning.backlash[1], 0.0, math.inf),
        ("effort_offset of the hip", tuning.effort_offset[0], -math.inf, math.inf),
        ("effort_offset of the slide", tuning.effort_offset[1], -math.inf, math.inf),
    ):
        if not (math.isfinite(value) and least <= value <= most):
            raise TuningError(f"{name} = {value}: must be a number in {least}..{most}")
    over_hip, over_slide = tuning.friction_over_position
    for name, friction in (("hip", hip), ("slide", slide)):
        least = smallest_stribeck(friction)
        if friction.stribeck <= least:
            raise TuningError(
                f"friction of the {name}: stribeck = {friction.stribeck} must exceed "
                f"coulomb tanh(peak / transition) + viscous peak = {least:.4g}"
            )
    along = levels_of(hip, over_hip), levels_of(slide, over_slide)
    inertia = smallest_inertia(leg, START_RATIO_MIN)
    try:
        needed = max(
            substeps_needed(one, other, inertia, tuning.integrator)
            for one, other in itertools.product(*along)
        )
    except ValueError as error:
        raise TuningError(f"integrator {tuning.integrator.name.lower()}: {error}") from error
    if tuning.substeps < needed:
        raise TuningError(
            f"substeps = {tuning.substeps} of {tuning.integrator.name.lower()}: "
            f"this friction needs {needed} at least"
        )


@kernel
def begin_at(
    setup_of: Setup, memory_of: Sequence[LegMemory], hip_rad: float, slide_m: float
) -> bool:
    """Start at rest at a pose if it is possible."""
    constants = constants_of(setup_of[0])
    possible = may_start(constants.model.leg, hip_rad, slide_m)
    if possible:
        begin_at_rest(constants.model, constants.options, memory_of[0], hip_rad, slide_m)
    return possible


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _caller_bits(*given: bool) -> Status:
    bits = Status(0)
    for bit, is_set in zip(CALLER_BITS, given, strict=True):
        bits |= bit if is_set else Status(0)
    return bits
