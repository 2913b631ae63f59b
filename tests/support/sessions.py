"""Sessions of the whole service against the virtual machine, in lock-step, faster than time."""

import multiprocessing
import shutil
import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from gaitd_names import EventCode, Mode, RequestKind
from msgspec.structs import replace as replace_fields

from analysis.accuracy import Score, score
from daemon.config.bundle import Settings
from daemon.core.modes.persistent_state import PersistentState
from daemon.ipc.record import CycleRecord, ModeRequest
from daemon.ipc.report import Event
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession

CONFIGS = Path(__file__).parents[2] / "configs"
AXES = ("hip", "slide")


@cache
def demo() -> Settings:
    """The shipped demo.toml, read and checked once in a process."""
    return load(CONFIGS / "demo.toml")


def briefly_announced(settings: Settings) -> Settings:
    """The same, but a gait is announced for half a second."""
    gait = replace_fields(settings.trainer.gait, announce_s=0.5)
    trainer = replace_fields(settings.trainer, gait=gait)
    return replace(settings, file=replace(settings.file, trainer=trainer))


def new_session(
    configs: Path = CONFIGS, persistent: PersistentState | None = None
) -> LockstepSession:
    """The service and the machine of a folder's demo.toml, at power-on, briefly announced."""
    return LockstepSession(briefly_announced(load(configs / "demo.toml")), persistent=persistent)


def restarted(session: LockstepSession) -> LockstepSession:
    """A new core on the same machine: the one before has ended without its shutdown."""
    return LockstepSession(
        session.settings, session.machine, persistent=session.state_file.persistent
    )


def single_axis_run(session: LockstepSession, mode: Mode, axis: str) -> list[CycleRecord]:
    """A homing or a sign test from its request to the drives' usual limits; its records."""
    begun = len(session.records)
    session.execute(RequestKind.MODE, ModeRequest(mode, axis=axis))
    session.until(Mode.OFF, within_s=60)
    session.until_ready()
    return session.records[begun:]


def reported(records: Iterable[CycleRecord], *codes: EventCode) -> list[Event]:
    """The events of these codes in the records, oldest first."""
    return [event for record in records for event in record.events if event.code in codes]


def scores(session: LockstepSession, duration_s: float) -> dict[str, Score]:
    """Run on and compare the patient's effort with the truth where it is valid (moving)."""
    begun = len(session.records)
    session.run(duration_s)
    rows = {row.sync_mono_ns: row for row in session.truth.rows}
    pairs = [
        (record.legs[0], rows[record.sync_mono_ns])
        for record in session.records[begun:]
        if record.sync_mono_ns in rows
    ]
    found: dict[str, Score] = {}
    for axis, name in enumerate(AXES):
        estimate = np.array(
            [leg.axes[axis].patient if leg.axes[axis].validity == 0 else np.nan for leg, _ in pairs]
        )
        column = "hip_patient_nm" if axis == 0 else "slide_patient_n"
        found[name] = score(estimate, np.array([getattr(row, column) for _, row in pairs]))
    return found


def elsewhere(session: Any, plan: Callable[[Any], Any]) -> Any:
    """What this returns of a copy of the session: played in a fork, nothing changes here."""
    context = multiprocessing.get_context("fork")
    reader, writer = context.Pipe(duplex=False)
    child = context.Process(target=lambda: writer.send(plan(session)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads; see forked.py
        child.start()
    writer.close()
    try:
        return reader.recv()
    finally:
        child.join()


def reaches_rest_in_fault(session: LockstepSession, within_s: float = 3.0) -> None:
    """Turn until both joints have been at rest for 0.2 s, in mode fault. Raises if they are not."""

    def rests(record: CycleRecord) -> bool:
        return record.mode == Mode.FAULT and all(
            abs(row.hip_velocity_rad_per_s) < 0.05 and abs(row.slide_velocity_m_per_s) < 0.05
            for row in session.truth.rows[-20:]
        )

    session.run_until(rests, within_s)


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
