"""The reference controller in a lock-step session: the real observer and core, a reacting patient.

Records become the messages that the gateway makes of them, so the controller is given what a client
is given.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np
from controllers import NEUTRAL, Controller
from gaitd_assist import LegController, Settings, StrideLine, parse_settings
from gaitd_client import Stride
from gaitd_names import Mode, RequestKind
from sessions import CONFIGS, briefly_announced

from daemon.config.settings import Robot
from daemon.gateway import strides, translate
from daemon.gateway.tremor import LegTremor
from daemon.ipc.record import CycleRecord, ModeRequest, Setpoint
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.lockstep_gateway import Gateway
from gaitd_lab.patients import DT_S, Model, Patient, of_ability
from gaitd_lab.virtual_machine import load_plant, virtual_machine
from sim_drives.plant.settings import FrictionLaw

SHIPPED: Final = CONFIGS.parent / "clients" / "assist" / "configs" / "assist.toml"
TRANSPARENCY: Final = """
[transparency]
feedforward_ratio = 0.6
friction_error_ratio = 0.2
hip.friction_max_nm = 7.0
slide.friction_max_n = 75.0
hip.full_rad_per_s = 0.15
slide.full_m_per_s = 0.06
hip.tank_j = 0.2
slide.tank_j = 0.5
"""
CADENCE_HZ: Final = 0.3
DURATION_S: Final = 1800.0
STIFFNESS: Final = (300.0, 4000.0)
"""That of the shipped trainer's guidance: N·m/rad, N/m."""
RAMP_STRIDES: Final = 2.8
"""Time of the two strides in which amplitude and cadence rise, in strides of the full cadence."""


def shipped(changes: tuple[str, str] | None = None) -> Settings:
    """The example's settings, or with one text replaced."""
    text = SHIPPED.read_text(encoding="utf-8")
    if changes is not None:
        assert changes[0] in text
        text = text.replace(*changes)
    return parse_settings(text, SHIPPED)


def leg_controller(changes: tuple[str, str] | None = None) -> LegController:
    """One leg's, of these settings."""
    settings = shipped(changes)
    return settings.controller(STIFFNESS if settings.help.law == "estimate" else None)


class Answers:
    """A law of `Controller`: makes the messages of a record, and asks the reference controller."""

    def __init__(self, leg: LegController) -> None:
        self.leg = leg
        self.lines: list[StrideLine] = []
        self.tremor = LegTremor()
        self.strides: list[Stride] = []

    def __call__(self, record: CycleRecord) -> tuple[float, float, float]:
        stamp = translate.stamp_of("lockstep", record)
        view = translate.view_of(record.legs[0], record, stamp, self.tremor.now)
        self.tremor.add(view.common)
        stage = None if record.stage is None else record.stage
        answer = self.leg.answer(translate.estimate(view, record.cycle), stage)
        if view.leg.stride is not None:
            tremors = self.tremor.end_stride()
            self.strides.append(strides.stride(view.leg.stride, view, record.cycle, tremors))
            line = self.leg.end_stride(self.strides[-1])
            if line is not None:
                self.lines.append(line)
        return tuple(answer)


class Fixed(Answers):
    """Full guidance and no assist, with the strides of the same patient."""

    def __call__(self, record: CycleRecord) -> tuple[float, float, float]:
        super().__call__(record)
        return NEUTRAL


def of_leg(record: CycleRecord, index: int) -> CycleRecord:
    """The record as if the trainer had this leg alone."""
    drives = record.drives[2 * index : 2 * index + 2]
    return msgspec.structs.replace(record, legs=(record.legs[index],), drives=drives)


def assist_of(record: CycleRecord, index: int = 0) -> tuple[float, float]:
    """Assist in force on a leg: N·m, N."""
    leg = record.legs[index]
    return leg.hip.assist, leg.slide.assist


class EachLeg(Controller):
    """A controller with a law for each leg."""

    def setpoint(self, record: CycleRecord, leg: str) -> Setpoint:
        """For one leg."""
        index = self.legs.index(leg)
        self.law = self.each[index]
        return super().setpoint(of_leg(record, index), leg)

    each: Sequence[Answers]


class Walk(NamedTuple):
    """A gait of one leg under a controller, and what it was."""

    session: LockstepSession
    controller: Controller
    answers: Answers
    begin_cycle: int
    index: int
    """Place of the leg in the record."""

    def errors(self, begin: int = 0) -> np.ndarray:
        """Reference minus pose after the first `begin` strides, rows of rad and m."""
        return np.array(
            [
                [axis.reference_position - axis.measured_position for axis in one.legs[0].axes]
                for one in self.records(begin)
            ]
        )

    def assist(self, begin: int = 0) -> np.ndarray:
        """Assist in force after the first `begin` strides, rows of N·m and N."""
        return np.array([assist_of(one) for one in self.records(begin)])

    def assist_of_strides(self) -> list[np.ndarray]:
        """Assist in force in each stride, rows of N·m and N."""
        ends = [line.cycle for line in self.answers.lines]
        strides = [[] for _ in ends]
        for one in self.records():
            if one.cycle <= ends[-1]:
                strides[bisect_left(ends, one.cycle)].append(assist_of(one))
        return [np.array(assist) for assist in strides]

    def peaks(self) -> np.ndarray:
        """Largest size of the assist in each stride, rows of N·m and N."""
        return np.array([np.abs(assist).max(axis=0) for assist in self.assist_of_strides()])

    def leading_w(self, begin: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Mean power of assist and of guidance that brakes a motion ahead of its reference, W.

        Source: the guidance as in `daemon/core/steps/impedance.py`, of the reference in the record.
        """
        records = self.records(begin)
        references = np.array(
            [[axis.reference_position for axis in one.legs[0].axes] for one in records]
        )
        speeds = np.array([[drive.velocity for drive in one.drives] for one in records])
        ratios = np.array([[one.legs[0].stiffness_ratio] for one in records])
        gains = self.session.settings.trainer.gait.impedance
        springs = gains.hip.stiffness_nm_per_rad, gains.slide.stiffness_n_per_m
        dampers = gains.hip.damping_nm_s_per_rad, gains.slide.damping_n_s_per_m
        errors, rates = self.errors(begin), np.gradient(references, DT_S, axis=0) - speeds
        guidance = ratios * springs * errors + np.sqrt(ratios) * dampers * rates
        leads = errors * speeds < 0.0
        assist_w, guidance_w = (
            np.where(leads, np.minimum(effort * speeds, 0.0), 0.0).mean(axis=0)
            for effort in (self.assist(begin), guidance)
        )
        return assist_w, guidance_w

    def records(self, begin: int = 0) -> list[CycleRecord]:
        """Records of this leg after the first `begin` strides."""
        first = self.answers.lines[begin - 1].cycle if begin else self.begin_cycle
        return [of_leg(one, self.index) for one in self.session.records if first < one.cycle]


class Gym:
    """A session in a gait after its ramps, with passive patients, that a test continues."""

    def __init__(
        self,
        *,
        seed: int = 1,
        cadence_hz: float = CADENCE_HZ,
        law: FrictionLaw = FrictionLaw.PAPER,
        config: Path = CONFIGS / "demo.toml",
        other: Callable[[Robot], Robot] = lambda robot: robot,
    ) -> None:
        """Bring it up.

        Args:
            seed: of the plant's noise, and of the patient's.
            cadence_hz: of the gait.
            law: friction of the plant; the observer has the paper's.
            config: trainer file.
            other: the plant's own mechanism and friction, made of the observer's.
        """
        settings = briefly_announced(load(config))
        _, plant = load_plant(settings.file)
        friction = msgspec.structs.replace(plant.friction, law=law)
        plant = msgspec.structs.replace(plant, friction=friction)
        robot = other(settings.robot)
        machine = virtual_machine(settings.file, plant=plant, robot=robot, seed=seed)
        self.legs = tuple(leg.name for leg in settings.legs)
        self.patients = [
            Patient(robot, of_ability(0.0), seed + index) for index in range(len(self.legs))
        ]

        def exert(record: CycleRecord) -> None:
            for index, (leg, patient) in enumerate(zip(self.legs, self.patients, strict=True)):
                machine.trainers[leg].exert(*patient(of_leg(record, index)))

        self.session = LockstepSession(settings, machine, gateway=Gateway(exert)).enable()
        self.begin_gait(cadence_hz)
        self.session.run(RAMP_STRIDES / cadence_hz)

    def begin_gait(self, cadence_hz: float = CADENCE_HZ, amplitude_ratio: float = 1.0) -> None:
        """Run to the first cycle of a gait."""
        self._cadence_hz = cadence_hz
        gait = ModeRequest(
            Mode.GAIT,
            cadence_hz=cadence_hz,
            amplitude_ratio=amplitude_ratio,
            duration_s=DURATION_S,
        )
        self.session.execute(RequestKind.MODE, gait)
        self.session.run_until(lambda record: record.gait_phase >= 0, within_s=30.0)

    def walk(self, model: Model, strides_count: int, answers: Answers | None = None) -> Walk:
        """Walk this many strides with a patient under the reference controller, or to a stop."""
        return self.walk_legs([model], strides_count, answers and [answers])[0]

    def walk_legs(
        self, models: Sequence[Model], strides_count: int, each: Sequence[Answers] | None = None
    ) -> list[Walk]:
        """As `walk`, with a model for each leg."""
        each = each or [Answers(leg_controller()) for _ in models]
        begin_cycle, counts = self.session.record.cycle, [len(one.lines) for one in each]
        for patient, model in zip(self.patients, models, strict=True):
            patient.become(model)
        controller = self.session.gateway.controller
        if not isinstance(controller, EachLeg) or list(controller.each) != list(each):
            controller = EachLeg(self.session.gateway, each[0], self.legs)
            controller.each = each

        def walked(record: CycleRecord) -> bool:
            made = min(len(one.lines) - count for one, count in zip(each, counts, strict=True))
            return made >= strides_count or record.mode != Mode.GAIT

        self.session.run_until(walked, within_s=(strides_count + 4) / self._cadence_hz)
        return [
            Walk(self.session, controller, answers, begin_cycle, index)
            for index, answers in enumerate(each)
        ]
