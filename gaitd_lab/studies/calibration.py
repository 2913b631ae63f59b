"""`python -m gaitd_lab.studies.calibration FOLDER`: calibration with known truth.

The empty virtual machine has other friction than the service's file. Its recordings are calibrated
with several seeds of all noise; the report has medians and ranges, and the pictures of the first.
"""

import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

import numpy as np
from gaitd_toml import load_toml

from analysis.calibration.figures import draw_friction, draw_residuals
from analysis.calibration.fit import Result
from analysis.calibration.quantities import COUNT, NOISE, QUANTITIES, value_of
from analysis.calibration.session import Calibration, calibrate
from analysis.recording import Recording
from analysis.replay import Source
from daemon.config.edits import edit
from daemon.config.settings import Robot
from daemon.config.shipped import configs_folder
from gaitd_lab.excitation import EmptyMachine
from gaitd_lab.studies.report import Cell, Report, Table, measured, write

SEEDS: Final = 20
FITTED: Final = ("friction_hip", "friction_slide")
HELD_OUT: Final = "open_loop"
FILE: Final = "robot_empty.toml"
TRUE_FILE: Final = "robot_true.toml"
HIP_AMPLITUDE_RATIO: Final = 1.4
"""Ratio of the amplitudes over the shipped ones, as the hip's friction is higher."""
FRICTION: Final = {
    "friction.hip.coulomb_nm": 8.0,
    "friction.hip.stribeck_nm": 9.6,
    "friction.hip.viscous_nm_s_per_rad": 1.3,
    "friction.hip.transition_rad_per_s": 0.008,
    "friction.hip.peak_rad_per_s": 0.04,
    "friction.hip.edge_rad_per_s": 0.025,
    "friction.slide.coulomb_n": 48.0,
    "friction.slide.stribeck_n": 58.0,
    "friction.slide.viscous_n_s_per_m": 85.0,
    "friction.slide.transition_m_per_s": 0.005,
    "friction.slide.peak_m_per_s": 0.025,
    "friction.slide.edge_m_per_s": 0.015,
}
"""Values of the plant; all else is as in the service's file."""
PLANT_LAG_S: Final = 0.125e-3
"""The plant takes the velocity at the beginning of a step of 0.25 ms for friction in its middle, so
its law is that much later than its time constant says."""
SCORES: Final = (
    ("minus log likelihood per sample", "loss_per_sample"),
    ("mean NIS of the observer (2 is ideal)", "nis"),
    ("false hip torque, N·m rms while moving", "hip_rms_nm"),
    ("false slide force, N rms while moving", "slide_rms_n"),
)


class Drawn(NamedTuple):
    """The calibration with one seed."""

    calibration: Calibration
    encoder_noise: tuple[float, float]
    """Rms of the virtual encoders: rad, m."""


def machine_files(folder: Path) -> Path:
    """Copy the shipped configuration, with another plant; return its trainer file."""
    shipped = configs_folder("configs", FILE)
    configs = shutil.copytree(shipped, folder / "configs")
    shutil.copy(configs / FILE, configs / TRUE_FILE)
    edit(configs, {"plant.toml": {"robot": TRUE_FILE}, TRUE_FILE: FRICTION})
    trainer = configs / "demo.toml"
    larger = re.sub(
        r'(axis = "hip", kind = "\w+", amplitude_si = )([-\d.]+)',
        lambda found: f"{found[1]}{HIP_AMPLITUDE_RATIO * float(found[2]):g}",
        trainer.read_text("utf-8"),
    )
    trainer.write_text(larger, "utf-8")
    return trainer


def drawn(config: Path, seed: int) -> Drawn:
    """Record and calibrate with one seed.

    Raises:
        NotPlayedError: the service refused a scenario, or stopped before its end.
        RecordingError: a recording cannot be calibrated.
    """
    machine = EmptyMachine(config, seed=seed)
    runs = {
        name: machine.play(name, machine.longest_s(name), lambda _: None).run
        for name in (*FITTED, HELD_OUT)
    }
    sources = {
        name: Source(Recording(name, run.time_s, run.measured, run.exerted), None, "", None)
        for name, run in runs.items()
    }
    made = calibrate(
        [sources[name] for name in FITTED],
        load_toml(config.with_name(FILE), Robot),
        [sources[HELD_OUT]],
    )
    wrong = np.concatenate([run.measured - run.true_position for run in runs.values()])
    hip, slide = np.sqrt(np.mean(wrong**2, axis=0)).tolist()
    return Drawn(made, (hip, slide))


def tables(draws: Sequence[Drawn], truth: Robot) -> tuple[Table, ...]:
    """Return the calibrated quantities beside their truth, the scores, and what intervals hold."""
    head = ("quantity", "unit", "file before", "truth", "calibrated", "95 %, ±", "error", "inside")
    title = f"`{HELD_OUT}`, which took no part, as the observer sees it with either file"
    return (
        Table(f"Calibrated with {len(draws)} seeds", head, [*_quantities(draws, truth)]),
        Table(title, ("", "before", "after"), [*_scores(draws)]),
        Table("Share of intervals that hold the truth", ("", "share"), [*_coverage(draws, truth)]),
    )


class _Known(NamedTuple):
    """A quantity with its truth, and its result with each seed."""

    place: int
    truth: float
    results: list[Result]

    @property
    def inside(self) -> list[bool]:
        """Whether an interval holds the truth, of each seed that calibrated the quantity."""
        return [
            abs(one.value - self.truth) <= one.half_interval
            for one in self.results
            if one.calibrated
        ]


def _known(draws: Sequence[Drawn], truth: Robot) -> Iterator[_Known]:
    noise = np.median([one.encoder_noise for one in draws], axis=0).tolist()
    for index, quantity in enumerate(QUANTITIES):
        results = [one.calibration.fit.results[index] for one in draws]
        if not results[0].exists:
            continue
        true = noise[index - COUNT] if _of_encoder(index) else value_of(truth, quantity.key)
        if quantity.key.endswith("time_constant_s"):
            true += PLANT_LAG_S
        yield _Known(index, true, results)


def _of_encoder(index: int) -> bool:
    return index >= NOISE


def _quantities(draws: Sequence[Drawn], truth: Robot) -> Iterator[tuple[Cell, ...]]:
    for one in _known(draws, truth):
        quantity, found = QUANTITIES[one.place], [got for got in one.results if got.calibrated]
        errors = (100 * (got.value / one.truth - 1) for got in found if one.truth)
        yield (
            quantity.label,
            quantity.unit,
            f"{one.results[0].before:.5g}",
            f"{one.truth:.3g}" if _of_encoder(one.place) else f"{one.truth:.5g}",
            f"{np.median([got.value for got in one.results]):.4g}",
            f"{np.median([got.half_interval for got in found]):.2g}" if found else None,
            measured(errors, "%"),
            f"{sum(one.inside)} of {len(found)}" if found else None,
        )


def _coverage(draws: Sequence[Drawn], truth: Robot) -> Iterator[tuple[Cell, ...]]:
    inside = {QUANTITIES[one.place].label: one.inside for one in _known(draws, truth)}
    shares = {label: float(np.mean(flags)) for label, flags in inside.items() if flags}
    lowest = min(shares, key=lambda label: shares[label])
    yield "all of them", float(np.mean([flag for flags in inside.values() for flag in flags]))
    yield f"the lowest of a quantity: {lowest}", shares[lowest]


def _scores(draws: Sequence[Drawn]) -> Iterator[tuple[Cell, ...]]:
    for title, field in SCORES:
        yield (
            title,
            *(
                measured(getattr(getattr(one.calibration, of), field) for one in draws)
                for of in ("before", "after")
            ),
        )


def study(seeds: int = SEEDS) -> Report:
    """Record and calibrate with each seed.

    Raises:
        NotPlayedError: the service refused a scenario, or stopped before its end.
        RecordingError: a recording cannot be calibrated.
    """
    with TemporaryDirectory() as folder:
        config = machine_files(Path(folder))
        draws = [drawn(config, seed) for seed in range(1, seeds + 1)]
        made = tables(draws, load_toml(config.with_name(TRUE_FILE), Robot))
    first = draws[0].calibration
    figures = {"friction": draw_friction(first), "residuals": draw_residuals(first)}
    return Report("calibration", "Calibration of a machine with known truth", made, figures)


if __name__ == "__main__":
    write(study(), Path(sys.argv[1]), "python -m gaitd_lab.studies.calibration FOLDER")
