"""Trials: the real loop on the virtual machine over CAN frames, faster than real time, with truth.

A trial is recorded once and can be replayed with any number of observers. The same situation and
the same configuration give the same bits. Nothing is written to a disk.

    trials = Trials(configs / "demo.toml")
    trial = trials.gait(Situation(cadence_hz=0.5, programme="active"), duration_s=30.0)
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from gaitd_names import Cause, Mode
from gaitd_toml import load_toml
from numpy.typing import NDArray

from analysis.recording import Recording
from daemon.config.edits import replaced
from daemon.config.limit_settings import Limits
from daemon.config.robot import friction_parameters, leg_parameters
from daemon.config.settings import Robot
from daemon.config.trainer import beside
from daemon.ipc.record import CycleRecord, LegRecord
from daemon.preflight.files import check_together
from daemon.preflight.load import read_all
from gaitd_lab.lockstep import LockstepSession, RefusedError
from gaitd_lab.trial import Flags, Trial, Values
from gaitd_lab.virtual_machine import load_plant, virtual_machine
from observer.filter.states import STATE_NAMES
from observer.mechanism.mechanism import gravity
from sim_drives.plant.settings import FrictionLaw, PlantTransmission, Programme
from sim_drives.plant.truth import TruthLog, TruthRow

EMPTY: Final = "robot_empty.toml"
TURN_S: Final = 0.25
"""Simulated time between two progress reports."""
MOTION_HIP_RAD_PER_S: Final = 0.05
"""Hip speed below which a motion has not begun yet, or was stopped."""
REST_BEGINS_S: Final = 1.0
"""Time at the start of a rest that is not evaluated: the estimate is new."""

STATIC_LOAD_RATIO: Final = 1.5
"""Least tolerance of the static load, as a share of breakaway friction."""

Progress = Callable[[float], None]
"""Receives the progress, 0 to 1."""


class Situation(NamedTuple):
    """The plant and the scripted patient of a trial."""

    law: FrictionLaw = FrictionLaw.PAPER
    cadence_hz: float = 0.25
    programme: str = "passive"
    """One of plant.toml's [[patient.programme]]."""
    seed: int | None = None
    """Seed of noise and delays; plant.toml's own if None."""
    transmission: PlantTransmission = PlantTransmission()
    """Between the drives and the joints."""

    @property
    def name(self) -> str:
        """Title of the situation."""
        return f"{self.law.value}, {self.cadence_hz:g} Hz, {self.programme}"


class TrialError(Exception):
    """A trial did not begin; the message gives the reason."""


class Trials:
    """Records trials on the virtual machine of one configuration."""

    def __init__(
        self,
        config: Path,
        robot: Robot | None = None,
        programmes: tuple[Programme, ...] = (),
        seed: int | None = None,
    ) -> None:
        """Read all files.

        Args:
            config: trainer file with a plant.
            robot: replaces the configuration's own, for the plant and for the service: another
                patient, other friction. See `balanced`.
            programmes: of the patient, added to those of plant.toml.
            seed: of all noise; None: plant.toml's.

        Raises:
            ConfigError: in a file, or between the files.
        """
        self._config = config
        self._settings = read_all(config)
        self._path, plant = load_plant(self._settings.file)
        patient = msgspec.structs.replace(
            plant.patient, programme=(*plant.patient.programme, *programmes)
        )
        seed = plant.seed if seed is None else seed
        self._plant = msgspec.structs.replace(plant, patient=patient, seed=seed)
        self._robot = robot or self._settings.robot
        limits = _limits_for(self._settings.limits, self._robot)
        self._settings = replace(self._settings, robot=self._robot, limits=limits)
        check_together(self._settings)

    @property
    def robot(self) -> Robot:
        """Robot of plant and service."""
        return self._robot

    @property
    def legs(self) -> tuple[str, ...]:
        """Names of the legs, in the order of the trainer file."""
        return tuple(leg.name for leg in self._settings.legs)

    @property
    def start_pose(self) -> tuple[float, float]:
        """Pose of the plant at power-on: rad, m."""
        start = self._plant.start
        return math.radians(start.hip.position_deg), start.slide.position_m

    def gait(
        self, situation: Situation, duration_s: float, progress: Progress | None = None
    ) -> Trial:
        """Record gait of the first leg; see `gait_of_legs`."""
        return next(iter(self.gait_of_legs(situation, duration_s, progress).values()))

    def gait_of_legs(
        self, situation: Situation, duration_s: float, progress: Progress | None = None
    ) -> dict[str, Trial]:
        """Record gait: enable, approach, gait, for a time from its first stride on.

        Returns: the trial of each leg, by its name, in the order of the trainer file.

        Raises:
            TrialError: the service refused it. A service that stops later shortens the trial.
        """
        run = self._run(situation.name, self._robot, situation)
        begun = run.begin(lambda session: session.walk(cadence_hz=situation.cadence_hz))
        run.on(duration_s, Mode.GAIT, progress)
        return {leg: run.trial(begun, leg, while_moving=True) for leg in self.legs}

    def excite(self, scenario: str, duration_s: float, progress: Progress | None = None) -> Trial:
        """Record the empty machine moved by torque; its artificial disturbance counts as patient.

        Raises:
            TrialError: the service refused it.
            ConfigError: there is no empty machine beside the robot file.
        """
        run = self._run(f"scenario {scenario}, empty", self._empty(), Situation())
        begun = run.begin(lambda session: session.excite(scenario, duration_s))
        run.on(duration_s, Mode.EXCITE, progress)
        return run.trial(begun, self.legs[0], while_moving=True)

    def rest(self, duration_s: float, progress: Progress | None = None) -> Trial:
        """Record a rest: enabled, holding the pose, a passive patient.

        Raises:
            TrialError: the service refused it.
        """
        run = self._run("at rest", self._robot, Situation())
        begun = run.begin(lambda session: session.enable().until(Mode.HOLD))
        run.on(duration_s, Mode.HOLD, progress)
        first = begun + round(REST_BEGINS_S / run.period_s)
        return run.trial(first, self.legs[0], while_moving=False)

    def _run(self, name: str, robot: Robot, situation: Situation) -> "_Run":
        settings = replace(self._settings, robot=robot)
        friction = msgspec.structs.replace(self._plant.friction, law=situation.law)
        patient = msgspec.structs.replace(self._plant.patient, start=situation.programme)
        plant = msgspec.structs.replace(
            self._plant,
            friction=friction,
            patient=patient,
            transmission=situation.transmission,
        )
        truths = {leg: TruthLog(None) for leg in self.legs}
        machine = virtual_machine(
            settings.file,
            plant=plant,
            robot=robot,
            seed=situation.seed,
            truth=truths,
        )
        return _Run(name, LockstepSession(settings, machine), truths)

    def _empty(self) -> Robot:
        path = beside(self._config, self._settings.trainer.robot).with_name(EMPTY)
        return load_toml(path, Robot)


def balanced(robot: Robot, pose: tuple[float, float]) -> Robot:
    """Return the robot with its springs preloaded to carry the leg at a pose.

    Args:
        robot: the changed robot, for example with another patient.
        pose: hip angle rad, slide position m.
    """
    hip, slide = robot.springs.hip, robot.springs.slide
    slack = replaced(robot, {"springs.hip.rest_rad": pose[0], "springs.slide.rest_m": pose[1]})
    load = gravity(leg_parameters(slack), np.array(pose))
    return replaced(
        robot,
        {
            "springs.hip.rest_rad": pose[0] + load[0] / hip.stiffness_nm_per_rad,
            "springs.slide.rest_m": pose[1] + load[1] / slide.stiffness_n_per_m,
        },
    )


def _limits_for(limits: Limits, robot: Robot) -> Limits:
    """Return limits for higher friction, which can hide more load at rest."""
    hip, slide = friction_parameters(robot)
    least_nm, least_n = STATIC_LOAD_RATIO * hip.stribeck, STATIC_LOAD_RATIO * slide.stribeck
    change = msgspec.structs.replace
    return change(
        limits,
        hip=change(
            limits.hip,
            static_load_tolerance_nm=max(limits.hip.static_load_tolerance_nm, least_nm),
        ),
        slide=change(
            limits.slide,
            static_load_tolerance_n=max(limits.slide.static_load_tolerance_n, least_n),
        ),
    )


class _Run:
    """A trial that is being recorded."""

    def __init__(self, name: str, session: LockstepSession, truths: Mapping[str, TruthLog]) -> None:
        self._name, self._session, self._truths = name, session, truths
        self.period_s: Final = 1e-3 * session.settings.trainer.cycle.period_ms

    def begin(self, begin: Callable[[LockstepSession], object]) -> int:
        """Run from power-on to the begin of the trial; return the index of its first record."""
        try:
            begin(self._session)
        except RefusedError as error:
            raise TrialError(f"{self._name}: {error}") from error
        return len(self._session.records) - 1

    def on(self, duration_s: float, mode: Mode, progress: Progress | None) -> None:
        """Run for a time, or until the service leaves the mode."""
        turns = max(round(duration_s / TURN_S), 1)
        for turn in range(turns):
            if self._session.record.mode != mode:
                break
            self._session.run(min(TURN_S, duration_s))
            if progress is not None:
                progress((turn + 1) / turns)

    def trial(self, begun: int, leg: str, *, while_moving: bool) -> Trial:
        """Return all rows with a known truth of a leg; those since `begun` are evaluated."""
        rows = {row.sync_mono_ns: row for row in self._truths[leg].rows}
        place = list(self._truths).index(leg)
        paired = [
            (index, record, rows[record.sync_mono_ns])
            for index, record in enumerate(self._session.records)
            if record.legs and record.sync_mono_ns in rows
        ]
        pairs = [(record, row) for _, record, row in paired]
        recording, truth = _columns(self._name, pairs, place)
        judged = np.array([index >= begun for index, _, _ in paired])
        if while_moving:
            judged &= _from_first_to_last(judged & (np.abs(truth[:, 2]) > MOTION_HIP_RAD_PER_S))
        return Trial(
            self._name, recording, truth, self._session.settings.robot, judged, self._why()
        )

    def _why(self) -> str:
        verdict = self._session.record.verdict
        return "" if verdict.cause is Cause.NONE else f"{verdict.drive}: {verdict.cause}"


def of_axes(legs: Sequence[LegRecord], field: str) -> NDArray[Any]:
    """Return a field of hip and slide in each record of a leg, shape (n, 2)."""
    pairs = [(getattr(leg.hip, field), getattr(leg.slide, field)) for leg in legs]
    return np.array(pairs).reshape(-1, 2)


def _columns(
    name: str, pairs: list[tuple[CycleRecord, TruthRow]], place: int
) -> tuple[Recording, Values]:
    """Recording and truth of the leg at a place of the records."""
    first_ns = pairs[0][0].sync_mono_ns
    legs = [record.legs[place] for record, _ in pairs]
    recording = Recording(
        name,
        np.array([(record.sync_mono_ns - first_ns) * 1e-9 for record, _ in pairs]),
        of_axes(legs, "measured_position"),
        of_axes(legs, "effort"),
    )
    truth = np.array([attrgetter(*STATE_NAMES)(row) for _, row in pairs])
    truth[:, 6:8] += np.nan_to_num(of_axes(legs, "artificial"))
    return recording, truth


def _from_first_to_last(flags: Flags) -> Flags:
    raised = np.flatnonzero(flags)
    rows = np.arange(len(flags))
    return (rows >= raised[0]) & (rows <= raised[-1]) if len(raised) else flags
