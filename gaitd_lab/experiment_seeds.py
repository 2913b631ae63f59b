"""The paper's experiment with several seeds of all noise, and the tables of docs/experiment.md."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from analysis import markdown
from analysis.delay import Delay
from analysis.experiment import Row, Run, marks
from analysis.experiment_claims import claims_table
from analysis.experiment_table import rows
from analysis.experiment_targets import Figure, Plant, Scales, figures
from analysis.replay import setup_for
from gaitd_lab.excitation import EmptyMachine
from gaitd_lab.trials import Situation, Trials
from sim_drives.plant.settings import FrictionLaw

SCENARIO: Final = "paper"
PLANTS: Final = {
    FrictionLaw.PAPER: Plant.MATCHED,
    FrictionLaw.LUGRE: Plant.BRISTLES,
    FrictionLaw.PAPER_STICKING: Plant.STICKING,
}
PARTS: Final = ("numbers", "claims")
"""Generated parts of the page."""
GAIT_S: Final = 30.0
CADENCES_HZ: Final = (0.25, 0.5)

Begin = Callable[[str, float], Callable[[float], None]]
"""Receives title and seconds of a scenario, and returns a callback for its progress."""


class Draws(NamedTuple):
    """The experiment of one plant, once for each seed."""

    machine: EmptyMachine
    """With the first seed."""
    run: Run
    """The first seed's, for the pictures."""
    rows: list[tuple[Row, ...]]
    """The table of each seed."""
    trouble: str
    """Why a run ended early, after which none is played; empty if all reached their end."""

    @property
    def scales(self) -> Scales:
        """Sizes that relative targets refer to."""
        hip, slide = np.max(np.abs(self.run.artificial), axis=0).tolist()
        friction = self.machine.frictions
        return Scales((friction[0].coulomb, friction[1].coulomb), (hip, slide))

    def figures(self) -> tuple[Figure, ...]:
        """The table over all seeds, with its targets."""
        return figures(self.rows, PLANTS[self.machine.law], self.scales)


def draw(machines: Sequence[EmptyMachine], seconds: float, begin: Begin) -> Draws:
    """Play the scenario on machines that differ in their seed.

    Raises:
        NotPlayedError: the service refused it, or stopped before.
    """
    made: list[tuple[Row, ...]] = []
    runs: list[Run] = []
    for machine in machines:
        title = f"{machine.law.value}, seed {machine.seed}"
        run, trouble = machine.play(SCENARIO, seconds, begin(title, seconds))
        runs.append(run)
        if trouble:
            return Draws(machines[0], runs[0], made, f"seed {machine.seed}: {trouble}")
        when = marks(machine.settings.trainer.excite[SCENARIO])
        table = rows(run, when, machine.frictions, setup_for(machine.settings.robot))
        made.append((*table, *_delay_rows(machine.delays(run, begin))))
    return Draws(machines[0], runs[0], made, "")


def with_tables(text: str, plants: Sequence[Draws], config: Path, begin: Begin) -> str:
    """Return docs/experiment.md with the tables of these draws; the first plant is the matched one.

    Raises:
        ValueError: the page has no place for them.
        TrialError: gait was refused.
    """
    matched = plants[0]
    with_gait = [
        (*draw, *_gait_rows(Trials(config, seed=matched.machine.seed + number), begin))
        for number, draw in enumerate(matched.rows)
    ]
    numbers: list[str] = []
    for one in plants:
        made = one.figures()
        targets = [figure.judged for figure in made if figure.judged]
        numbers.append(f"### Plant with {PLANTS[one.machine.law].value}, `{one.machine.law.value}`")
        if targets:
            met = sum(target.met for target in targets)
            numbers.append(
                f"{met} of {len(targets)} targets are met with each of {len(one.rows)} seeds."
            )
        head = ("", "hip", "slide", "target", "")
        numbers.append(markdown.table(head, (figure.cells() for figure in made)))
    claims = claims_table(with_gait, matched.scales)
    return markdown.filled(text, dict(zip(PARTS, ("\n\n".join(numbers), claims), strict=True)))


def _delay_rows(found: tuple[Delay, Delay] | str) -> tuple[Row, ...]:
    if isinstance(found, str):
        return (Row("delay of the effort", None, None, "ms", "ms"),)
    hip, slide = (one.delay_ms if one.known else None for one in found)
    return (Row("delay of the effort", hip, slide, "ms", "ms"),)


def _gait_rows(trials: Trials, begin: Begin) -> list[Row]:
    made: list[Row] = []
    for cadence_hz in CADENCES_HZ:
        title = f"gait at {cadence_hz:g} Hz"
        trial = trials.gait(Situation(cadence_hz=cadence_hz), GAIT_S, begin(title, 1.0))
        hip, slide = 100 * (1 - trial.moving[trial.judged].mean(axis=0))
        made.append(Row(f"{title}: time at rest", float(hip), float(slide), "%", "%"))
    return made
