"""Sessions of the whole service against the virtual machine, in lock-step, faster than time."""

import multiprocessing
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from analysis.accuracy import Score, score
from daemon.core.modes.persistent_state import PersistentState
from daemon.ipc.record import (
    CycleRecord,
    Mode,
    ModeRequest,
    Outcome,
    RequestKind,
    RequestResult,
    Stage,
)
from daemon.preflight.load import load
from gaitd_lab.lockstep import Lockstep
from gaitd_lab.virtual_machine import virtual_machine
from sim_drives.build import Machine
from sim_drives.plant.truth import TruthLog

CONFIGS = Path(__file__).parents[2] / "configs"
AXES = ("hip", "slide")


class Session:
    """One machine and one service, from power-on."""

    def __init__(self, configs: Path = CONFIGS, notes: PersistentState | None = None) -> None:
        self.settings = load(configs / "demo.toml")
        self.truth = TruthLog(None)
        self.machine: Machine = virtual_machine(self.settings.file, truth={"right": self.truth})
        self.lockstep = Lockstep(self.settings, self.machine.world, notes=notes)

    def until_ready(self) -> "Session":
        self.lockstep.run_until(lambda record: record.mode == Mode.READY, within_s=10)
        self.lockstep.run(0.2)
        return self

    def enabled(self) -> "Session":
        """In hold, if it is not there already."""
        if self.lockstep.records and self.lockstep.record.mode == Mode.HOLD:
            return self
        self.until_ready()
        answer = self.lockstep.request(RequestKind.ENABLE)
        assert answer.outcome == Outcome.DONE, answer.reason
        return self

    def walking(self, *, cadence_hz: float = 0.25, warm_s: float = 8.0) -> "Session":
        """In the middle of a gait, its ramps behind it."""
        self.enabled()
        gait = ModeRequest(Mode.GAIT, cadence_hz=cadence_hz, amplitude_ratio=1.0, duration_s=600.0)
        answer = self.lockstep.request(RequestKind.MODE, gait)
        assert answer.outcome == Outcome.DONE, answer.reason
        self.lockstep.run_until(lambda record: record.gait_phase >= 0, within_s=30)
        self.lockstep.run(warm_s)
        return self

    def prepare(self, mode: Mode, axis: str, *, witnessed: bool = False) -> RequestResult:
        """Ask for a homing or a sign test of one axis."""
        wanted = ModeRequest(mode, axis=axis, witnessed=witnessed)
        return self.lockstep.request(RequestKind.MODE, wanted)

    def prepared(self, mode: Mode, axis: str) -> list[CycleRecord]:
        """A homing or a sign test from its request to the drives' usual limits; its records."""
        begun = len(self.lockstep.records)
        answer = self.prepare(mode, axis)
        assert answer.outcome == Outcome.DONE, answer.reason
        self.lockstep.run_until(lambda record: record.mode == Mode.OFF, within_s=60)
        self.lockstep.run_until(lambda record: record.mode == Mode.READY, within_s=10)
        self.lockstep.run(0.2)
        return self.lockstep.records[begun:]

    def exciting(self, scenario: str, duration_s: float) -> "Session":
        self.enabled()
        wanted = ModeRequest(Mode.EXCITE, duration_s=duration_s, scenario=scenario)
        answer = self.lockstep.request(RequestKind.MODE, wanted)
        assert answer.outcome == Outcome.DONE, answer.reason
        self.lockstep.run_until(lambda record: record.stage is Stage.PLAYING, within_s=30)
        return self

    def scores(self, duration_s: float) -> dict[str, Score]:
        """Run on and compare the patient's effort with the truth where it is valid (moving)."""
        begun = len(self.lockstep.records)
        self.lockstep.run(duration_s)
        rows = {row.sync_mono_ns: row for row in self.truth.rows}
        pairs = [
            (record.legs[0], rows[record.sync_mono_ns])
            for record in self.lockstep.records[begun:]
            if record.sync_mono_ns in rows
        ]
        found: dict[str, Score] = {}
        for axis, name in enumerate(AXES):
            estimate = np.array(
                [leg.state[6 + axis] if leg.validity[axis] == 0 else np.nan for leg, _ in pairs]
            )
            column = "hip_patient_nm" if axis == 0 else "slide_patient_n"
            found[name] = score(estimate, np.array([getattr(row, column) for _, row in pairs]))
        return found


def elsewhere(session: Any, play: Callable[[Any], Any]) -> Any:
    """What this returns of a copy of the session: played in a fork, nothing changes here."""
    context = multiprocessing.get_context("fork")
    reader, writer = context.Pipe(duplex=False)
    child = context.Process(target=lambda: writer.send(play(session)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads; see forked.py
        child.start()
    writer.close()
    try:
        return reader.recv()
    finally:
        child.join()


def reaches_rest_in_fault(session: Session, within_s: float = 3.0) -> None:
    """Turn until both joints have been at rest for 0.2 s, in mode fault. Raises if they are not."""

    def rests(record: CycleRecord) -> bool:
        return record.mode == Mode.FAULT and all(
            abs(row.hip_velocity_rad_per_s) < 0.05 and abs(row.slide_velocity_m_per_s) < 0.05
            for row in session.truth.rows[-20:]
        )

    session.lockstep.run_until(rests, within_s)


def changed_configs(folder: Path, *changes: tuple[str, str, str]) -> Path:
    """A copy of the repository's configs with (file, old text, new text) replaced."""
    copy = folder / "configs"
    shutil.copytree(CONFIGS, copy)
    for name, old, new in changes:
        text = (copy / name).read_text()
        assert old in text, f"{name} does not say {old!r}"
        (copy / name).write_text(text.replace(old, new))
    return copy


def empty_machine(folder: Path) -> Path:
    """Configs of the machine without a patient, for the service and for the plant."""
    return changed_configs(
        folder,
        ("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
        ("plant.toml", '"robot.toml"', '"robot_empty.toml"'),
    )


POSITION_GUIDANCE = ("demo.toml", 'guidance = "impedance"', 'guidance = "position"')
"""A change for `changed_configs`: the drives' own loops play the gait (CSP)."""


def position_guidance(folder: Path, *changes: tuple[str, str, str]) -> Path:
    """Configs with guidance = "position", and more changes."""
    return changed_configs(folder, POSITION_GUIDANCE, *changes)


def generic_drives(folder: Path) -> Path:
    """Configs with the CiA-standard drives in place of the EPOS4-like ones."""
    return changed_configs(
        folder,
        ("demo.toml", "hip_epos4", "hip_generic"),
        ("demo.toml", "slide_epos4", "slide_generic"),
        ("plant.toml", 'personality = "epos4"', 'personality = "generic"'),
        ("plant.toml", "epos4.eds", "generic402.eds"),
    )


def elmo_drives(folder: Path) -> Path:
    """Configs with Elmo-like drives in place of the EPOS4-like ones."""
    return changed_configs(
        folder,
        ("demo.toml", "hip_epos4", "hip_elmo"),
        ("demo.toml", "slide_epos4", "slide_elmo"),
        ("plant.toml", 'personality = "epos4"', 'personality = "elmo_gold"'),
        ("plant.toml", "epos4.eds", "elmo_gold.eds"),
    )


def two_legs(folder: Path) -> Path:
    """Configs in which demo.toml is the shipped example with two legs on one bus."""
    configs = changed_configs(folder)
    shutil.copyfile(configs / "two_legs.toml", configs / "demo.toml")
    return configs
