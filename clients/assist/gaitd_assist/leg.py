"""The controller of one leg: its laws, when they may learn, and the line of each stride in the log.

Rules:
1. A law learns only in mode gait while the stage is `playing`, and an axis only while its pose is
   known. At rest, where patient and friction cannot be separated, it is: a leg that is too weak to
   move is helped.
2. Approach, ramp-down and every state that is not known get a neutral setpoint: that is the machine
   without a controller. The service ramps to it. So does the first estimate after a gap: without
   the velocity of the reference, assist would follow the leg.
3. Help is kept from block to block. It is forgotten after a restart of the core or a pause of ten
   minutes, because another patient may lie in the machine.
4. Above the cadence of the file the answer is neutral, too: in simulation, at 0.5 Hz, assist on top
   of a passive leg made it so fast that the service stopped it before its limits.
5. What leaves this file is within the caps of the file. The program compares them with the limits
   of the service and of the released plan when it starts, so nothing is refused for its size. A
   plan with lower caps that is released later makes the core refuse what is above them in the next
   gait of a session: the leg is then braked and held.
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import Final

from gaitd_client import Assist, Estimate, Mode, Stage, Stride, Validity

from gaitd_assist.law import Law, Memory, Pair, Sample, Values
from gaitd_assist.phase_help import HelpRules, PhaseHelp
from gaitd_assist.transparency import Transparency, TransparencyRules

GAP_CYCLES: Final = 5
"""More cycles than this between two estimates are a gap: nothing is learned over it."""
MEMORY_CYCLES: Final = 60_000
"""After a longer pause, ten minutes, another patient may lie in the machine: help is forgotten."""
NEUTRAL: Final = Assist()
NO_EFFORT: Final = (0.0, 0.0)
ANSWER_CYCLES: Final = 10
"""After that, a setpoint is in force, or too old for the service; the assist may rise to its limit
in about as much time."""
CUT_RATIO: Final = 0.1
"""Share of the cap by which less than the setpoints of `ANSWER_CYCLES` must be in force."""
STRIDE_KNOWN_MIN_RATIO: Final = 0.5
"""Least share of a stride in which an axis was known; below, it has no error."""


class StrideLine(Memory, frozen=True, kw_only=True):
    """A line of the log: a stride with its errors, and the memory of all laws after it."""

    sample_time_ns: int
    core_boot_id: str
    cycle: int
    leg: str
    number: int
    """Number of the stride."""
    learned: bool
    """False: too little of it was known, so it has no errors."""


class LegController:
    """All laws of one leg; call `answer` with each estimate."""

    def __init__(
        self,
        rules: HelpRules,
        cap: Pair,
        cadence_max_hz: float,
        transparency: TransparencyRules | None = None,
    ) -> None:
        """Begin with full stiffness and without assist.

        Args:
            rules: constants of guidance and assist.
            cap: largest assist of all laws together: N·m, N.
            cadence_max_hz: faster gaits get a neutral setpoint.
            transparency: None: friction is not fed forward.
        """
        self._cap, self._help = cap, PhaseHelp(rules)
        self.laws: list[Law] = [self._help]
        if transparency is not None:
            self.laws.append(Transparency(transparency))
        self._cadence_max_hz = cadence_max_hz
        self._before: Estimate | None = None
        self._is_playing = False
        self._played: Estimate | None = None
        """The newest estimate of a gait."""
        self._stride_number: int | None = None
        self._begin_cycle = 0
        """First cycle of this gait that was answered."""
        self._asked: deque[Pair] = deque([NO_EFFORT], maxlen=ANSWER_CYCLES)
        """The newest setpoints."""
        self._clear()

    def answer(self, estimate: Estimate, stage: Stage | str | None) -> Assist:
        """Return the setpoint for an estimate.

        Args:
            estimate: of this leg; called in modes torque and gait.
            stage: of the message `safety`; None: not known.
        """
        before, self._before = self._before, estimate
        was_playing = self._is_playing
        self._is_playing = estimate.mode == Mode.GAIT and stage == Stage.PLAYING
        if self._is_playing:
            if not was_playing:
                self._begin_gait(estimate)
            self._played = estimate
        if estimate.mode == Mode.GAIT and not self._is_playing:
            return NEUTRAL
        sample = sample_of(estimate, before)
        if sample is None:
            return NEUTRAL
        cadence_hz = sample.cadence_hz
        if self._is_playing and (not cadence_hz or cadence_hz > self._cadence_max_hz):
            return NEUTRAL
        sample = sample._replace(is_cut=self._cut(estimate))
        setpoint = NEUTRAL
        for law in self.laws:
            setpoint = law.answer(sample, setpoint)
        hip_nm, slide_n = (
            min(max(effort, -cap), cap) for effort, cap in zip(setpoint[:2], self._cap, strict=True)
        )
        self._stride_s += sample.dt_s
        for axis, effort in enumerate((hip_nm, slide_n)):
            self._assist[axis] += sample.dt_s * abs(effort)
            if sample.learns[axis]:
                self._known_s[axis] += sample.dt_s
                self._squares[axis] += sample.dt_s * sample.error[axis] ** 2
        self._asked.append((hip_nm, slide_n))
        return Assist(hip_nm, slide_n, setpoint.stiffness_ratio)

    def end_stride(self, stride: Stride) -> StrideLine | None:
        """Tell the laws that a stride is over.

        Args:
            stride: the newest one; one that was given before is ignored.

        Returns: the line for the log; None outside of a gait, and for a stride before its answers.
        """
        is_new = stride.number != self._stride_number
        self._stride_number = stride.number
        if not is_new or not self._is_playing or stride.cycle <= self._begin_cycle:
            return None
        for law in self.laws:
            law.end_stride()
        errors = [
            math.sqrt(square / known_s)
            if known_s > STRIDE_KNOWN_MIN_RATIO * self._stride_s
            else None
            for square, known_s in zip(self._squares, self._known_s, strict=True)
        ]
        assist = [total / self._stride_s if self._stride_s else 0.0 for total in self._assist]
        self._clear()
        own: list[Values] = [
            {"error_rms": error, "assist_mean": mean}
            for error, mean in zip(errors, assist, strict=True)
        ]
        states = [law.state() for law in self.laws]
        return StrideLine(
            sample_time_ns=stride.sample_time_ns,
            core_boot_id=stride.core_boot_id,
            cycle=stride.cycle,
            leg=stride.leg,
            number=stride.number,
            learned=errors != [None, None],
            values={"share_ratio": stride.share_ratio} | _merged(one.values for one in states),
            hip=own[0] | _merged(one.hip for one in states),
            slide=own[1] | _merged(one.slide for one in states),
        )

    def _cut(self, estimate: Estimate) -> tuple[bool, bool]:
        """Return whether clearly less is in force than any of the newest setpoints."""
        hip, slide = (
            given is not None and min(map(abs, asked)) - abs(given) > CUT_RATIO * cap
            for asked, given, cap in zip(
                zip(*self._asked, strict=True),
                (estimate.hip.assist, estimate.slide.assist),
                self._cap,
                strict=True,
            )
        )
        return hip, slide

    def _begin_gait(self, estimate: Estimate) -> None:
        self._begin_cycle, played = estimate.cycle, self._played
        if played is None or not _follows(played, estimate, MEMORY_CYCLES):
            self._help.forget()
        self._asked.clear()
        self._asked.append(NO_EFFORT)
        self._clear()
        for law in self.laws:
            law.begin_gait()

    def _clear(self) -> None:
        self._stride_s = 0.0
        self._known_s, self._squares, self._assist = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]


def _merged(parts: Iterable[Values]) -> Values:
    return {name: value for part in parts for name, value in part.items()}


def sample_of(estimate: Estimate, before: Estimate | None) -> Sample | None:
    """Return what the laws need of an estimate; None: pose, velocity or time step is not known.

    Args:
        estimate: the newest one.
        before: the one before it; None, a gap or a restart of the core: nothing is learned.
    """
    hip, slide = estimate.hip, estimate.slide
    at = _pair((hip.position, slide.position))
    speed = _pair((hip.velocity, slide.velocity))
    if at is None or speed is None or estimate.dt_s is None or estimate.dt_s <= 0.0:
        return None
    dt_s, phase_ratio, aim = estimate.dt_s, estimate.gait_phase_ratio, _aim_of(estimate)
    friction = hip.friction, slide.friction
    if estimate.mode != Mode.GAIT or phase_ratio is None or aim is None:
        zero, no = (0.0, 0.0), (False, False)
        return Sample(dt_s, None, None, zero, zero, speed, friction, no)
    error, rate, cadence_hz = (aim[0] - at[0], aim[1] - at[1]), (0.0, 0.0), None
    follows = before is not None and _follows(before, estimate, GAP_CYCLES)
    last = _aim_of(before) if before is not None and follows else None
    if before is not None and before.gait_phase_ratio is not None and last is not None:
        dt_s *= estimate.cycle - before.cycle
        cadence_hz = (phase_ratio - before.gait_phase_ratio) % 1.0 / dt_s
        rate = (aim[0] - last[0]) / dt_s - speed[0], (aim[1] - last[1]) / dt_s - speed[1]
    is_known = hip.validity != Validity.BAD, slide.validity != Validity.BAD
    learns = (is_known[0] and last is not None, is_known[1] and last is not None)
    return Sample(
        dt_s,
        phase_ratio,
        cadence_hz,
        error,
        rate,
        speed,
        friction,
        learns,
        needed=(hip.needed, slide.needed),
        patient=(hip.patient, slide.patient),
        patient_std=(hip.patient_std, slide.patient_std),
    )


def _follows(before: Estimate, estimate: Estimate, within_cycles: int) -> bool:
    """Return whether an estimate comes so soon after one of a gait."""
    same = before.core_boot_id == estimate.core_boot_id and before.gait_phase_ratio is not None
    return same and 0 < estimate.cycle - before.cycle <= within_cycles


def _aim_of(estimate: Estimate) -> Pair | None:
    return _pair((estimate.hip.reference_position, estimate.slide.reference_position))


def _pair(values: tuple[float | None, float | None]) -> Pair | None:
    hip, slide = values
    return None if hip is None or slide is None else (hip, slide)
