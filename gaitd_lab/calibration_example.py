"""`python -m gaitd_lab.calibration_example docs/calibration.md`: calibration with known truth.

The empty virtual machine has other friction than the service's file. Its recordings are calibrated
with several seeds of all noise; the page gets medians and ranges, and the pictures of the first.
"""

import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

import numpy as np

from analysis import markdown
from analysis.calibration.figures import draw_friction, draw_residuals
from analysis.calibration.quantities import QUANTITIES, value_of
from analysis.calibration.session import Calibration, calibrate
from analysis.recording import Recording
from analysis.replay import Source
from analysis.spread import in_words, spread
from daemon.config.edits import edit
from daemon.config.settings import Robot
from daemon.config.shipped import configs_folder
from daemon.config.strict import load_toml
from gaitd_lab.excitation import EmptyMachine

SEEDS: Final = 10
PART: Final = "example"
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


def part(draws: Sequence[Drawn], truth: Robot) -> str:
    """Return the generated part of the page."""
    head = ("quantity", "unit", "file before", "truth", "calibrated", "95 %, ±", "error")
    scores = ("", "before", "after")
    return markdown.page(
        f"Median (range) of {len(draws)} seeds:",
        markdown.table(head, _quantities(draws, truth)),
        "On `open_loop`, which took no part in the fit, as the observer sees it with either file:",
        markdown.table(scores, _scores(draws)),
    ).rstrip("\n")


def _quantities(draws: Sequence[Drawn], truth: Robot) -> Iterator[tuple[str, ...]]:
    noise = np.median([one.encoder_noise for one in draws], axis=0).tolist()
    for index, quantity in enumerate(QUANTITIES):
        results = [one.calibration.fit.results[index] for one in draws]
        if not results[0].exists:
            continue
        of_encoder = len(QUANTITIES) - index <= len(noise)
        true = noise[index - len(QUANTITIES)] if of_encoder else value_of(truth, quantity.key)
        found = [one.value if one.calibrated else None for one in results]
        yield (
            quantity.label,
            quantity.unit,
            f"{results[0].before:.5g}",
            f"{true:.3g}" if of_encoder else f"{true:.5g}",
            f"{np.median([one.value for one in results]):.4g}",
            f"{np.median([one.half_interval for one in results]):.2g}",
            in_words(spread(one and 100 * (one / true - 1) for one in found), "%"),
        )


def _scores(draws: Sequence[Drawn]) -> Iterator[tuple[str, ...]]:
    for title, field in SCORES:
        yield (
            title,
            *(
                in_words(spread(getattr(getattr(one.calibration, of), field) for one in draws))
                for of in ("before", "after")
            ),
        )


def main(page: Path, seeds: int = SEEDS) -> None:
    """Write the page's generated part and its pictures.

    Raises:
        ValueError: the page has no place for it.
    """
    text = page.read_text("utf-8")
    markdown.filled(text, {PART: ""})  # refused before the work
    with TemporaryDirectory() as folder:
        config = machine_files(Path(folder))
        draws: list[Drawn] = []
        for seed in range(1, seeds + 1):
            draws.append(drawn(config, seed))
            print(f"seed {seed}: {draws[-1].calibration.fault or 'calibrated'}", flush=True)
        truth = load_toml(config.with_name(TRUE_FILE), Robot)
    page.write_text(markdown.filled(text, {PART: part(draws, truth)}), "utf-8")
    first = draws[0].calibration
    draw_friction(first, page.with_name("calibration_friction.png"))
    draw_residuals(first, page.with_name("calibration_residuals.png"))


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
