"""The reference controller in a lock-step session: the real observer and core, a reacting patient.

Records become the messages that the gateway makes of them, so the controller is given what a client
is given.
"""

from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np
from controllers import NEUTRAL, Controller
from gaitd_assist import LegController, Settings, StrideLine, parse_settings
from sessions import CONFIGS

from daemon.gateway import strides, translate
from daemon.ipc.record import CycleRecord, Mode, ModeRequest, RequestKind
from daemon.preflight.load import load
from daemon.wire.names import name_of
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.lockstep_gateway import Gateway
from gaitd_lab.patients import Model, Patient, of_ability
from gaitd_lab.virtual_machine import load_plant, virtual_machine
from sim_drives.plant.settings import FrictionLaw

SHIPPED: Final = CONFIGS.parent / "clients" / "assist" / "configs" / "assist.toml"
TRANSPARENCY: Final = """
[transparency]
feedforward_ratio = 0.6
friction_error_ratio = 0.2
hip_friction_max_nm = 7.0
slide_friction_max_n = 75.0
hip_full_rad_per_s = 0.15
slide_full_m_per_s = 0.06
hip_tank_j = 0.2
slide_tank_j = 0.5
"""
CADENCE_HZ: Final = 0.3
DURATION_S: Final = 1800.0
RAMP_STRIDES: Final = 2.8
"""Time of the two strides in which amplitude and cadence rise, in strides of the full cadence."""


def shipped(changes: tuple[str, str] | None = None) -> Settings:
    """The example's settings, or with one text replaced."""
    text = SHIPPED.read_text(encoding="utf-8")
    if changes is not None:
        assert changes[0] in text
        text = text.replace(*changes)
    return parse_settings(text, SHIPPED)


class Answers:
    """A law of `Controller`: makes the messages of a record, and asks the reference controller."""

    def __init__(self, leg: LegController) -> None:
        self.leg = leg
        self.lines: list[StrideLine] = []

    def __call__(self, record: CycleRecord) -> tuple[float, float, float]:
        view = translate.view_of(record.legs[0], record, translate.stamp_of("lockstep", record))
        stage = None if record.stage is None else name_of(record.stage)
        answer = self.leg.answer(translate.estimate(view, record.cycle), stage)
        if view.leg.stride is not None:
            line = self.leg.end_stride(strides.stride(view.leg.stride, view, record.cycle))
            if line is not None:
                self.lines.append(line)
        return tuple(answer)


class Fixed(Answers):
    """Full guidance and no assist, with the strides of the same patient."""

    def __call__(self, record: CycleRecord) -> tuple[float, float, float]:
        super().__call__(record)
        return NEUTRAL


class Walk(NamedTuple):
    """A gait under a controller, and what it was."""

    session: LockstepSession
    controller: Controller
    answers: Answers
    begin_cycle: int

    def errors(self, begin: int = 0) -> np.ndarray:
        """Reference minus pose after the first `begin` strides, rows of rad and m."""
        return np.array(
            [np.subtract(one.legs[0].reference, one.legs[0].measured) for one in self._from(begin)]
        )

    def assist(self, begin: int = 0) -> np.ndarray:
        """Assist in force after the first `begin` strides, rows of N·m and N."""
        return np.array([one.assist.legs[0].assist for one in self._from(begin)])

    def _from(self, begin: int) -> list[CycleRecord]:
        first = self.answers.lines[begin - 1].cycle if begin else self.begin_cycle
        return [one for one in self.session.records if first < one.cycle]


class Gym:
    """A session in a gait after its ramps, with a passive patient, that a test continues."""

    def __init__(
        self,
        *,
        seed: int = 1,
        cadence_hz: float = CADENCE_HZ,
        law: FrictionLaw = FrictionLaw.PAPER,
        config: Path = CONFIGS / "demo.toml",
    ) -> None:
        """Bring it up.

        Args:
            seed: of the plant's noise, and of the patient's.
            cadence_hz: of the gait.
            law: friction of the plant; the observer has the paper's.
            config: trainer file.
        """
        settings = load(config)
        _, plant = load_plant(settings.file)
        friction = msgspec.structs.replace(plant.friction, law=law)
        plant = msgspec.structs.replace(plant, friction=friction)
        machine = virtual_machine(settings.file, plant=plant, seed=seed)
        trainer = machine.trainers["right"]
        patient = Patient(settings.robot, of_ability(0.0), seed)
        gateway = Gateway(lambda record: trainer.exert(*patient(record)))
        self.patient, self._cadence_hz = patient, cadence_hz
        self.session = LockstepSession(settings, machine, gateway=gateway).enable()
        gait = ModeRequest(
            Mode.GAIT, cadence_hz=cadence_hz, amplitude_ratio=1.0, duration_s=DURATION_S
        )
        self.session.execute(RequestKind.MODE, gait)
        self.session.run_until(lambda record: record.gait_phase >= 0, within_s=30.0)
        self.session.run(RAMP_STRIDES / cadence_hz)

    def walk(self, model: Model, strides_count: int, answers: Answers | None = None) -> Walk:
        """Walk this many strides with a patient under the reference controller, or to a stop."""
        answers = answers or Answers(shipped().controller())
        begin_cycle = self.session.record.cycle
        self.patient.become(model)
        controller = Controller(self.session.gateway, answers)
        self.session.run_until(
            lambda record: len(answers.lines) >= strides_count or record.mode != Mode.GAIT,
            within_s=(strides_count + 4) / self._cadence_hz,
        )
        return Walk(self.session, controller, answers, begin_cycle)
