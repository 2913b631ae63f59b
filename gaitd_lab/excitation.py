"""An excite scenario on the empty virtual machine, in lock-step: the real loop, frames and drives.

Everything is in memory: no bus, no port, no file is written. The same configuration and seed give
the same bits.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np
from gaitd_names import Cause, Mode, Stage
from gaitd_toml import ConfigError, load_toml

from analysis.delay import Delay, measure
from analysis.recording import Recording, RecordingError
from daemon.config.bundle import Settings
from daemon.config.robot import friction_parameters
from daemon.config.settings import Robot
from daemon.config.trainer import beside
from daemon.core.runtime.texts import verdict_text
from daemon.ipc.record import CycleRecord
from daemon.preflight.files import check_together
from daemon.preflight.load import read_all
from gaitd_lab.lockstep import LockstepSession, NotReachedError, RefusedError
from gaitd_lab.lockstep_gateway import Gateway
from gaitd_lab.studies.experiment.measures import Run
from gaitd_lab.trials import of_axes
from gaitd_lab.virtual_machine import load_plant, load_robot, virtual_machine
from observer.filter.leg_model import STEP_S
from observer.mechanism.friction import FrictionParameters
from sim_drives.plant.settings import FrictionLaw
from sim_drives.plant.truth import TruthLog, TruthRow

EMPTY: Final = "robot_empty.toml"
DELAY: Final = "delay"
"""Scenario with quick efforts, from which delays are measured."""
TURN_S: Final = 0.25
"""Simulated time between two progress reports."""
STICKING_FROZEN_CYCLES: Final = 200
"""Time limit of the frozen-encoder check, with ideal sticking: the hip then stands without a count
for a second while its torque reverses and the slide unloads it, which looks the same.
"""
STATES: Final = ("position", "velocity", "friction", "patient")
"""Fields of an axis in the order of `observer.filter.states`."""


class Played(NamedTuple):
    """Result of a scenario."""

    runs: dict[str, Run]
    """What each leg did, by its name, in the order of the trainer file."""
    trouble: str
    """Reason of an early end; empty if there was none."""

    @property
    def run(self) -> Run:
        """What the first leg did."""
        return next(iter(self.runs.values()))


class NotPlayedError(Exception):
    """The scenario did not begin; the message gives the reason."""


class EmptyMachine:
    """The empty machine of a configuration, whose plant may have another friction law."""

    def __init__(
        self, config: Path, law: FrictionLaw | None = None, seed: int | None = None
    ) -> None:
        """Read all files.

        Args:
            config: trainer file with a plant.
            law: friction of the plant; None: plant.toml's.
            seed: of all noise; None: plant.toml's.

        Raises:
            ConfigError: in a file, or there is no empty machine beside it.
        """
        read = read_all(config)
        self.settings = replace(read, robot=_empty(read.robot, config, read.trainer.robot))
        path, plant = load_plant(read.file)
        own = load_robot(path, plant)
        self._robot = _empty(own, path, plant.robot)
        friction = msgspec.structs.replace(plant.friction, law=law or plant.friction.law)
        seed = plant.seed if seed is None else seed
        self._plant = msgspec.structs.replace(plant, friction=friction, seed=seed)
        if self.law is FrictionLaw.PAPER_STICKING:
            self.settings = _slow_to_doubt_encoders(self.settings)
        check_together(self.settings)

    @property
    def law(self) -> FrictionLaw:
        """Friction law of the plant."""
        return self._plant.friction.law

    @property
    def seed(self) -> int:
        """Seed of all noise."""
        return self._plant.seed

    @property
    def note(self) -> str:
        """Differences from the configuration; empty if there are none."""
        if self.law is not FrictionLaw.PAPER_STICKING:
            return ""
        return (
            f"the watch over frozen encoders waits {STICKING_FROZEN_CYCLES} cycles: an axis that "
            "sticks ideally looks like one"
        )

    @property
    def frictions(self) -> tuple[FrictionParameters, FrictionParameters]:
        """Friction of the plant: hip and slide."""
        return friction_parameters(self._robot)

    def longest_s(self, scenario: str) -> float:
        """Return the longest duration of a scenario.

        Raises:
            ConfigError: the trainer file has none of this name.
        """
        known = self.settings.trainer.excite
        if scenario not in known:
            file = self.settings.file.path
            allowed = f"a table [excite.{scenario}]"
            raise ConfigError(file, "excite", ", ".join(known), allowed, following="")
        return known[scenario].duration_max_s

    def play(
        self,
        scenario: str,
        seconds: float,
        progress: Callable[[float], None],
        on_record: Callable[[CycleRecord], None] | None = None,
    ) -> Played:
        """Run from power-on to the end of the scenario.

        Args:
            scenario: name of an [excite] table.
            seconds: duration of the scenario.
            progress: receives the simulated seconds of the scenario so far.
            on_record: receives every record, from power-on, as a gateway would.

        Raises:
            NotPlayedError: the service refused it, or stopped before.
        """
        truths = {leg.name: TruthLog(None) for leg in self.settings.legs}
        machine = virtual_machine(
            self.settings.file, plant=self._plant, robot=self._robot, truth=truths
        )
        session = LockstepSession(self.settings, machine, gateway=Gateway(on_record))
        try:
            session.excite(scenario, seconds)
        except RefusedError as error:
            raise NotPlayedError(str(error)) from error
        except NotReachedError as error:
            raise NotPlayedError(f"the scenario did not begin {error}") from error
        begun = len(session.records) - 1
        while session.record.mode == Mode.EXCITE:
            session.run(TURN_S)
            progress(min((len(session.records) - begun) * STEP_S, seconds))
        count = round(seconds / STEP_S)
        records = session.records[begun:]
        runs = {
            leg: _run(records, place, truth.rows, count)
            for place, (leg, truth) in enumerate(truths.items())
        }
        played = Played(runs, "")
        if len(played.run.time_s) == count:
            return played
        return played._replace(trouble=_why(session, played.run))

    def delays(
        self, played: Played, begin: Callable[[str, float], Callable[[float], None]]
    ) -> dict[str, tuple[Delay, Delay] | str]:
        """Measure the delays of each leg in the delay scenario, or in another; else why not.

        Args:
            played: another scenario, for a trainer file without one for the delay.
            begin: receives title and seconds of the scenario, and returns a callback for progress.
        """
        if DELAY in self.settings.trainer.excite:
            seconds = self.longest_s(DELAY)
            progress = begin("quick efforts, for the delay", seconds)
            try:
                played = self.play(DELAY, seconds, progress)
            except NotPlayedError as error:
                return dict.fromkeys(played.runs, str(error))
        return {leg: self._delay(run) for leg, run in played.runs.items()}

    def _delay(self, run: Run) -> tuple[Delay, Delay] | str:
        recording = Recording("the scenario", run.time_s, run.measured, run.exerted)
        try:
            return measure(recording, self.settings.robot)
        except RecordingError as error:
            return str(error)


def _playing(record: CycleRecord) -> bool:
    return record.mode == Mode.EXCITE and record.stage is Stage.PLAYING


def _run(records: list[CycleRecord], place: int, truth: list[TruthRow], count: int) -> Run:
    """Return the first `count` cycles of the scenario of a leg, each with the truth of its SYNC."""
    rows = {row.sync_mono_ns: row for row in truth}
    played = [one for one in records if _playing(one) and one.sync_mono_ns in rows][:count]
    legs = [record.legs[place] for record in played]
    true = [rows[record.sync_mono_ns] for record in played]
    artificial = of_axes(legs, "artificial")
    first_ns = played[0].sync_mono_ns if played else 0
    return Run(
        time_s=np.array([(record.sync_mono_ns - first_ns) * 1e-9 for record in played]),
        measured=of_axes(legs, "measured_position"),
        exerted=of_axes(legs, "effort") + artificial,
        artificial=artificial,
        state=np.hstack([of_axes(legs, name) for name in STATES]),
        std=np.hstack([of_axes(legs, f"{name}_std") for name in STATES]),
        net=of_axes(legs, "net"),
        nis=np.array([leg.nis for leg in legs]),
        validity=of_axes(legs, "validity"),
        status=np.array([leg.status for leg in legs]),
        true_position=np.array([(row.hip_angle_rad, row.slide_position_m) for row in true]),
        true_velocity=np.array(
            [(row.hip_velocity_rad_per_s, row.slide_velocity_m_per_s) for row in true]
        ),
        true_friction=np.array([(row.hip_friction_nm, row.slide_friction_n) for row in true]),
        true_effort=np.array([(row.hip_torque_nm, row.slide_force_n) for row in true]),
    )


def _why(session: LockstepSession, run: Run) -> str:
    verdict, at_s = session.record.verdict, run.time_s[-1] if len(run.time_s) else 0.0
    if verdict.cause == Cause.NONE:
        return f"the scenario ended at {at_s:.2f} s: an axis has left its window"
    return f"stopped at {at_s:.2f} s: {verdict_text(verdict)}"


def _empty(robot: Robot, file: Path, named: str) -> Robot:
    """Return the empty machine, with its springs reduced as in the file beside it."""
    if robot.patient is None:
        return robot
    path = beside(file, named).with_name(EMPTY)
    if not path.is_file():
        allowed = f"a robot without [patient], or {EMPTY} beside it"
        raise ConfigError(file, "robot", named, allowed, following="")
    springs = load_toml(path, Robot).springs
    return msgspec.structs.replace(robot, patient=None, springs=springs)


def _slow_to_doubt_encoders(settings: Settings) -> Settings:
    communication = msgspec.structs.replace(
        settings.limits.communication, encoder_frozen_cycles=STICKING_FROZEN_CYCLES
    )
    limits = msgspec.structs.replace(settings.limits, communication=communication)
    return replace(settings, limits=limits)
