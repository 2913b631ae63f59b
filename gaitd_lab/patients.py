"""Patients who react to the gait: each returns an effort for the newest record.

A patient knows the gait: `need` is the effort that the reference needs beyond what the drives carry
(inertia, Coriolis terms, dampers, friction), by inverse dynamics with the machine's own parameters.
An ability of 1 gives all of it, so that such a patient walks without help.

A model returns the patient's effort, N·m at the hip and N at the slide, positive along the positive
axis. `Patient` calls it once for each cycle:

    patient = Patient(settings.robot, of_ability(0.5), seed=1)
    gateway = Gateway(lambda record: trainer.exert(*patient(record)))

The sizes of these efforts are assumed, if no source is given: no measurement of this machine's
patients is known. The plant's activation (`activation_s` of plant.toml, 40 ms) acts on all of them:
it passes 62 % of an effort at 5 Hz, and 55 % at 6 Hz.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from daemon.config.robot import friction_parameters, leg_parameters
from daemon.config.settings import Robot
from daemon.ipc.record import CycleRecord
from observer.mechanism.linkage import dynamics

DT_S: Final = 0.01
BINS: Final = 32
BEGIN_S: Final = 1.0
"""Time in which a patient's effort rises to its full size; at once it would be a spasm."""
Effort = tuple[float, float]


class Gait(NamedTuple):
    """What a patient feels of one cycle; arrays are hip and slide."""

    time_s: float
    phase_ratio: float
    error: np.ndarray
    error_rate: np.ndarray
    need: np.ndarray
    direction: np.ndarray
    """-1 to 1: of the reference's velocity."""
    pose: np.ndarray


Model = Callable[[Gait], np.ndarray]
"""Effort of a patient: N·m and N."""


class Patient:
    """Calls a model with each cycle of a gait; at all other times the patient is passive."""

    def __init__(self, robot: Robot, model: Model, seed: int, place: int = 0) -> None:
        """Begin at rest.

        Args:
            robot: the machine that the patient knows.
            model: effort in gait.
            seed: of what varies in the effort.
            place: of the leg in a record.
        """
        self._place = place
        self._leg, self._frictions = leg_parameters(robot), friction_parameters(robot)
        self._model = model
        self._noise = np.random.default_rng(seed)
        self._tremor = np.zeros(2)
        self._poses: list[np.ndarray] = []
        self._time_s = 0.0
        self._last_error = np.zeros(2)

    def become(self, model: Model) -> None:
        """Go on as another model, whose effort rises from nothing."""
        self._model, self._time_s = model, 0.0

    def __call__(self, record: CycleRecord) -> Effort:
        """Effort until the next record."""
        leg = record.legs[self._place]
        if leg.gait_phase < 0:
            self._poses = []
            return 0.0, 0.0
        self._time_s += DT_S
        reference = np.array([axis.reference_position for axis in leg.axes])
        self._poses = [*self._poses[-2:], reference]
        if len(self._poses) < 3:
            return 0.0, 0.0
        error = reference - np.array([axis.measured_position for axis in leg.axes])
        rate, self._last_error = (error - self._last_error) / DT_S, error
        need, velocity = self._need()
        # A person's effort is never the same twice: 0.3 N m and 2 N, some 2 Hz. [A]
        self._tremor += 0.12 * (self._noise.normal(0.0, (1.2, 8.0)) - self._tremor)
        direction = np.tanh(velocity / 0.1)
        felt = Gait(self._time_s, leg.gait_phase, error, rate, need, direction, reference - error)
        effort = min(self._time_s / BEGIN_S, 1.0) * self._model(felt) + self._tremor
        return float(effort[0]), float(effort[1])

    def _need(self) -> tuple[np.ndarray, np.ndarray]:
        before, middle, now = self._poses
        velocity = (now - before) / (2 * DT_S)
        acceleration = (now - 2 * middle + before) / DT_S**2
        pose = float(middle[0]), float(middle[1])
        moving = dynamics(self._leg, *pose, float(velocity[0]), float(velocity[1]), 1.0)
        resting = dynamics(self._leg, *pose, 0.0, 0.0, 1.0)
        # No person turns friction over within 100 ms, so it is smooth here.
        friction = [
            of.coulomb * math.tanh(speed / 0.3) + of.viscous * speed
            for of, speed in zip(self._frictions, velocity, strict=True)
        ]
        mass = np.array([[moving.m11, moving.m12], [moving.m12, moving.m22]])
        bias = (moving.bias_hip - resting.bias_hip, moving.bias_slide - resting.bias_slide)
        return mass @ acceleration + bias + friction, velocity


def of_ability(ability: float) -> Model:
    """Give this share of the need, and correct errors by as much of a soft spring and damper.

    ability (need + 60 N·m/rad e + 6 N·m·s/rad e'), at the slide 800 N/m and 80 N·s/m.
    """
    spring, damper = np.array([60.0, 800.0]), np.array([6.0, 80.0])

    def model(gait: Gait) -> np.ndarray:
        return ability * (gait.need + spring * gait.error + damper * gait.error_rate)

    return model


class Late:
    """Exert everything as another model, later: reaction and activation of a slowed person."""

    def __init__(self, model: Model, delay_s: float = 0.12) -> None:
        """Delay a model's effort by `delay_s`, rounded to whole cycles; nothing before that."""
        count = round(delay_s / DT_S)
        self._model = model
        self._efforts = deque([np.zeros(2)] * count, maxlen=count + 1)

    def __call__(self, gait: Gait) -> np.ndarray:
        """Effort of `delay_s` ago."""
        self._efforts.append(self._model(gait))
        return self._efforts[0]


def weak(model: Model, begin_ratio: float = 0.1, end_ratio: float = 0.3) -> Model:
    """Lack all effort of another model between two phases of each stride, as after a paresis.

    The effort falls and rises over 0.05 of a stride.
    """
    edge_ratio = 0.05

    def weak_model(gait: Gait) -> np.ndarray:
        inside = min(gait.phase_ratio - begin_ratio, end_ratio - gait.phase_ratio)
        return model(gait) * min(max(-inside / edge_ratio, 0.0), 1.0)

    return weak_model


def trembling(gait: Gait) -> np.ndarray:
    """Passive, with a tremor of 5 Hz, 3 N·m and 15 N rms.

    Source of the frequency: Deuschl, Bain, Brin, "Consensus statement of the Movement Disorder
    Society on tremor", Mov. Disord. 13, Suppl. 3 (1998): rest tremor has 4 to 6 Hz.
    """
    return math.sqrt(2.0) * np.array([3.0, 15.0]) * math.sin(2.0 * math.pi * 5.0 * gait.time_s)


def clonic(gait: Gait) -> np.ndarray:
    """Passive, with clonus: bursts of 0.7 s every two seconds, 6 Hz, 10 N·m and 50 N.

    Source of the frequency: Boyraz, Uysal, Koc, Sarman, "Clonus: definition, mechanism, treatment",
    Med. Glas. 12 (2015): 5 to 8 Hz.
    """
    within_s = gait.time_s % 2.0
    wave = math.sin(2.0 * math.pi * 6.0 * within_s) if within_s < 0.7 else 0.0
    return np.array([10.0, 50.0]) * wave


class Spasm:
    """Passive, with one hard contraction against the motion: 30 N·m and 150 N.

    As the programme `spasm` of plant.toml: it rises in 60 ms, lasts 1.2 s, and falls in 0.8 s.
    """

    def __init__(self, at_s: float) -> None:
        """Contract `at_s` after the begin of the gait."""
        self._at_s = at_s
        self._direction: np.ndarray | None = None

    def __call__(self, gait: Gait) -> np.ndarray:
        """Effort of the one contraction, zero before and after it."""
        since_s = gait.time_s - self._at_s
        if since_s < 0.0:
            return np.zeros(2)
        if self._direction is None:
            self._direction = np.where(gait.direction < 0.0, -1.0, 1.0)
        envelope = min(since_s / 0.06, max((2.0 - since_s) / 0.8, 0.0), 1.0)
        return -np.array([30.0, 150.0]) * envelope * self._direction


def tiring(until_s: float) -> Model:
    """Able at first, without any strength from `until_s` on."""

    def model(gait: Gait) -> np.ndarray:
        return of_ability(max(1.0 - gait.time_s / until_s, 0.0))(gait)

    return model


def resisting(gait: Gait) -> np.ndarray:
    """Opposes the motion."""
    return -np.array([6.0, 30.0]) * gait.direction


def spastic(gait: Gait) -> np.ndarray:
    """Passive, with a catch against the motion in each stride, weaker than the spasm monitor's."""
    catch = math.exp(-0.5 * ((gait.phase_ratio - 0.3) / 0.04) ** 2)
    return -np.array([10.0, 50.0]) * catch * gait.direction


class Slacking:
    """Learns from errors and forgets, as people do: less error, less effort.

    Source: Emken 2007, the human's half of the law: u <- f u + g e in each stride, f = 0.9.
    """

    def __init__(self) -> None:
        self._effort = np.zeros((BINS, 2))
        self._sum, self._count, self._bin = np.zeros(2), 0, -1

    def __call__(self, gait: Gait) -> np.ndarray:
        """Effort that was learned for this phase."""
        at = int(gait.phase_ratio * BINS) % BINS
        if at != self._bin and self._count:
            mean = self._sum / self._count
            gain = np.array([13.0, 170.0])
            self._effort[self._bin] = 0.9 * self._effort[self._bin] + gain * mean
            self._sum, self._count = np.zeros(2), 0
        self._bin = at
        self._sum += gait.error
        self._count += 1
        return self._effort[at]
