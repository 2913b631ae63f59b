"""The controller of one leg: its laws, when they may learn, and the line of each stride in the log.

Rules:
1. A law learns only in mode gait while the stage is `playing`, and an axis only while its estimate
   is ok. At rest, where patient and friction cannot be separated, assist goes on unchanged.
2. Approach, ramp-down and every state that is not known get a neutral setpoint: that is the machine
   without a controller. The service ramps to it.
3. Each gait begins with full stiffness and no assist: those of the gait before may be for another
   cadence, amplitude or state of the patient.
4. Above the cadence of the file the answer is neutral, too: in simulation, at 0.5 Hz, assist on top
   of a passive leg made it so fast that the service stopped it before its limits.
5. What leaves this file is within the caps of the file. The program compares them with the limits
   of the service and of the released plan when it starts, so nothing is refused for its size. A
   plan with lower caps that is released later makes the core refuse what is above them in the next
   gait of a session: the leg is then braked and held.
"""

from typing import Final

import msgspec
from gaitd_client import Assist, Estimate, Mode, Stage, Stride, Validity

from gaitd_assist.guidance import Guidance, GuidanceRules
from gaitd_assist.law import Law, Pair, Sample
from gaitd_assist.phase_assist import PhaseAssist, PhaseRules
from gaitd_assist.transparency import Transparency, TransparencyRules

GAP_CYCLES: Final = 5
"""More cycles than this between two estimates are a gap: nothing is learned over it."""
NEUTRAL: Final = Assist()
REPORTED: Final = (
    "hip_error_rms_rad",
    "slide_error_rms_m",
    "share_ratio",
    "assist_mean_nm",
    "assist_mean_n",
)
"""Fields of a `StrideLine` that are published, besides its state."""


class StrideLine(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the log: a stride, and the memory of the laws after it."""

    sample_time_ns: int
    core_boot_id: str
    cycle: int
    leg: str
    number: int
    """Number of the stride."""
    learned: bool
    """False: too little of it was known, and the stiffness is unchanged."""
    hip_error_rms_rad: float | None
    slide_error_rms_m: float | None
    share_ratio: float | None
    """Share of the patient, as in the message of the stride."""
    assist_mean_nm: float
    """Mean size of the assist of the hip in this stride."""
    assist_mean_n: float
    state: dict[str, float | list[float]]

    def reported(self) -> dict[str, float | list[float] | None]:
        """Return the values of the line that are published, by name."""
        return {name: getattr(self, name) for name in REPORTED} | self.state


class LegController:
    """All laws of one leg; call `answer` with each estimate."""

    def __init__(
        self,
        guidance: GuidanceRules,
        phase: PhaseRules,
        cap: Pair,
        cadence_max_hz: float,
        transparency: TransparencyRules | None = None,
    ) -> None:
        """Begin with full stiffness and without assist.

        Args:
            guidance: constants of the stiffness.
            phase: constants of the assist over the stride.
            cap: largest assist of all laws together: N·m, N.
            cadence_max_hz: faster gaits get a neutral setpoint.
            transparency: None: friction is not fed forward.
        """
        self._guidance, self._cap = Guidance(guidance), cap
        self.laws: list[Law] = [self._guidance, PhaseAssist(phase)]
        if transparency is not None:
            self.laws.append(Transparency(transparency))
        self._cadence_max_hz, self._cadence_hz = cadence_max_hz, 0.0
        self._before: Estimate | None = None
        self._is_playing = False
        self._stride_number: int | None = None
        self._begin_cycle = 0
        """First cycle of this gait that was answered."""
        self._sums, self._count = [0.0, 0.0], 0

    def answer(self, estimate: Estimate, stage: Stage | str | None) -> Assist:
        """Return the setpoint for an estimate.

        Args:
            estimate: of this leg; called in modes torque and gait.
            stage: of the message `safety`; None: not known.
        """
        before, self._before = self._before, estimate
        was_playing = self._is_playing
        self._is_playing = estimate.mode == Mode.GAIT and stage == Stage.PLAYING
        if self._is_playing and not was_playing:
            self._begin_gait(estimate.cycle)
        if estimate.mode == Mode.GAIT and not self._is_playing:
            return NEUTRAL
        sample = sample_of(estimate, before)
        if sample is None:
            return NEUTRAL
        if sample.cadence_hz is not None:
            self._cadence_hz = sample.cadence_hz
        if self._is_playing and self._cadence_hz > self._cadence_max_hz:
            return NEUTRAL
        setpoint = NEUTRAL
        for law in self.laws:
            setpoint = law.answer(sample, setpoint)
        hip_nm, slide_n = (
            min(max(effort, -cap), cap) for effort, cap in zip(setpoint[:2], self._cap, strict=True)
        )
        self._sums[0] += abs(hip_nm)
        self._sums[1] += abs(slide_n)
        self._count += 1
        return Assist(hip_nm, slide_n, setpoint.stiffness_ratio)

    def end_stride(self, stride: Stride) -> StrideLine | None:
        """Learn from a stride.

        Args:
            stride: the newest one; one that was given before is ignored.

        Returns: the line for the log; None outside of a gait, and for a stride before its answers.
        """
        is_new = stride.number != self._stride_number
        self._stride_number = stride.number
        if not is_new or not self._is_playing or stride.cycle <= self._begin_cycle:
            return None
        errors = self._guidance.errors
        for law in self.laws:
            law.end_stride()
        count = max(self._count, 1)
        line = StrideLine(
            sample_time_ns=stride.sample_time_ns,
            core_boot_id=stride.core_boot_id,
            cycle=stride.cycle,
            leg=stride.leg,
            number=stride.number,
            learned=errors != (None, None),
            hip_error_rms_rad=errors[0],
            slide_error_rms_m=errors[1],
            share_ratio=stride.share_ratio,
            assist_mean_nm=self._sums[0] / count,
            assist_mean_n=self._sums[1] / count,
            state={name: value for law in self.laws for name, value in law.state().items()},
        )
        self._sums, self._count = [0.0, 0.0], 0
        return line

    def _begin_gait(self, cycle: int) -> None:
        self._begin_cycle = cycle
        self._sums, self._count, self._cadence_hz = [0.0, 0.0], 0, 0.0
        for law in self.laws:
            law.begin_gait()


def sample_of(estimate: Estimate, before: Estimate | None) -> Sample | None:
    """Return what the laws need of an estimate; None: pose, velocity or time step is not known.

    Args:
        estimate: the newest one.
        before: the one before it; None, a gap or a restart of the core: nothing is learned.
    """
    at = _pair((estimate.hip_angle_rad, estimate.slide_position_m))
    speed = _pair((estimate.hip_velocity_rad_per_s, estimate.slide_velocity_m_per_s))
    if at is None or speed is None or estimate.dt_s is None or estimate.dt_s <= 0.0:
        return None
    dt_s, phase_ratio, aim = estimate.dt_s, estimate.gait_phase_ratio, _aim_of(estimate)
    friction = estimate.hip_friction_nm, estimate.slide_friction_n
    if estimate.mode != Mode.GAIT or phase_ratio is None or aim is None:
        zero, no = (0.0, 0.0), (False, False)
        return Sample(dt_s, None, None, zero, zero, speed, friction, no)
    error, rate, cadence_hz = (aim[0] - at[0], aim[1] - at[1]), (0.0, 0.0), None
    follows = before is not None and _follows(before, estimate)
    last = _aim_of(before) if before is not None and follows else None
    if before is not None and before.gait_phase_ratio is not None and last is not None:
        dt_s *= estimate.cycle - before.cycle
        cadence_hz = (phase_ratio - before.gait_phase_ratio) % 1.0 / dt_s
        rate = (aim[0] - last[0]) / dt_s - speed[0], (aim[1] - last[1]) / dt_s - speed[1]
    is_ok = estimate.hip_validity == Validity.OK, estimate.slide_validity == Validity.OK
    learns = (is_ok[0] and last is not None, is_ok[1] and last is not None)
    return Sample(dt_s, phase_ratio, cadence_hz, error, rate, speed, friction, learns)


def _follows(before: Estimate, estimate: Estimate) -> bool:
    """Return whether two estimates are of the same gait, with few cycles between them."""
    same = before.core_boot_id == estimate.core_boot_id and before.gait_phase_ratio is not None
    return same and 0 < estimate.cycle - before.cycle <= GAP_CYCLES


def _aim_of(estimate: Estimate) -> Pair | None:
    return _pair((estimate.reference_hip_angle_rad, estimate.reference_slide_position_m))


def _pair(values: tuple[float | None, float | None]) -> Pair | None:
    hip, slide = values
    return None if hip is None or slide is None else (hip, slide)
