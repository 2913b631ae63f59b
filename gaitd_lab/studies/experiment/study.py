"""The report of `gaitd experiment`: its numbers over seeds, the paper's claims, Figs. 4 and 5."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from analysis.accuracy import moving
from analysis.delay import Delay
from analysis.replay import setup_for
from gaitd_lab.excitation import EmptyMachine, NotPlayedError
from gaitd_lab.studies.experiment.claims import claims_table, spread_of
from gaitd_lab.studies.experiment.figures import draw_axis, draw_details
from gaitd_lab.studies.experiment.measures import Row, Run, marks
from gaitd_lab.studies.experiment.rows import rows
from gaitd_lab.studies.experiment.targets import TARGETS, Plant, Scales, judge
from gaitd_lab.studies.report import Cell, Report, Table, of_leg
from gaitd_lab.trials import Situation, Trials
from sim_drives.plant.settings import FrictionLaw

SCENARIO: Final = "paper"
PLANTS: Final = {
    FrictionLaw.PAPER: Plant.MATCHED,
    FrictionLaw.LUGRE: Plant.BRISTLES,
    FrictionLaw.PAPER_STICKING: Plant.STICKING,
}
GAIT_S: Final = 30.0
CADENCES_HZ: Final = (0.25, 0.5)

Begin = Callable[[str, float], Callable[[float], None]]
"""Receives title and seconds of a scenario, and returns a callback for its progress."""


class Draws(NamedTuple):
    """The experiment of one leg of a plant, once for each seed."""

    machine: EmptyMachine
    """With the first seed."""
    run: Run
    """The first seed's, for the pictures."""
    rows: list[tuple[Row, ...]]
    """The table of each seed."""

    @property
    def scales(self) -> Scales:
        """Sizes that relative targets refer to."""
        hip, slide = np.max(np.abs(self.run.artificial), axis=0).tolist()
        friction = self.machine.frictions
        return Scales((friction[0].coulomb, friction[1].coulomb), (hip, slide))


def draw(machines: Sequence[EmptyMachine], seconds: float, begin: Begin) -> dict[str, Draws]:
    """Play the scenario on machines that differ in their seed; return what each leg did.

    Raises:
        NotPlayedError: the service refused it, or stopped before its end.
    """
    legs: dict[str, Draws] = {}
    for machine in machines:
        title = f"{machine.law.value}, seed {machine.seed}"
        played = machine.play(SCENARIO, seconds, begin(title, seconds))
        if played.trouble:
            raise NotPlayedError(f"seed {machine.seed}: {played.trouble}")
        delays = machine.delays(played, begin)
        when = marks(machine.settings.trainer.excite[SCENARIO])
        setup = setup_for(machine.settings.robot)
        for leg, run in played.runs.items():
            table = *rows(run, when, machine.frictions, setup), *_delay_rows(delays[leg])
            legs.setdefault(leg, Draws(machine, run, [])).rows.append(table)
    return legs


def study(
    config: Path, laws: Sequence[FrictionLaw], seeds: int, seconds: float, begin: Begin
) -> Report:
    """Play the scenario with several seeds on the empty machine, for each friction of the plant.

    Args:
        config: trainer file with a plant, whose seed is the first one.
        laws: of the plant; with the observer's own law the claims of the paper are held against it.
        seeds: draws of all noise.
        seconds: of the scenario.
        begin: begins a scenario by its title and seconds.

    Raises:
        NotPlayedError: the service refused the scenario, or stopped before its end.
        TrialError: gait was refused.
    """
    tables: list[Table] = []
    figures: dict[str, Figure] = {}
    passed = True
    for law in laws:
        first = EmptyMachine(config, law)
        machines = [first, *(EmptyMachine(config, law, first.seed + n) for n in range(1, seeds))]
        legs = draw(machines, seconds, begin)
        if law is FrictionLaw.PAPER and seconds == first.longest_s(SCENARIO):
            gaits = [_gait_rows(Trials(config, seed=one.seed), begin) for one in machines]
            tables += [
                claims_table(
                    [(*row, *gait[leg]) for row, gait in zip(draws.rows, gaits, strict=True)],
                    draws.scales,
                    of_leg(leg, legs),
                )
                for leg, draws in legs.items()
            ]
        for leg, draws in legs.items():
            table, met = _numbers(draws, PLANTS[law], of_leg(leg, legs), first.note)
            tables.append(table)
            passed = passed and met
        figures = figures or _figures(legs)
    title = "The paper's experiment, repeated"
    return Report("experiment", title, tuple(tables), figures, passed)


def _numbers(draws: Draws, plant: Plant, leg: str, note: str) -> tuple[Table, bool]:
    """Return the table of one leg of a plant, and whether every seed met every target."""
    targets = {target.row: target for target in TARGETS if plant in target.plants}
    rows: list[tuple[Cell, ...]] = []
    passed = True
    for same in zip(*draws.rows, strict=True):
        target = targets.get(same[0].name)
        judged = judge(target, same, draws.scales) if target else None
        passed = passed and (judged is None or judged.met)
        words = (judged.words, str(judged)) if judged else ("", "")
        rows.append((*spread_of(same), *words))
    title = f"Plant with {plant.value}{leg}, {len(draws.rows)} seeds"
    title += f" ({note})" if note else ""
    return Table(title, ("", "hip", "slide", "target", ""), rows), passed


def _figures(legs: Mapping[str, Draws]) -> dict[str, Figure]:
    """Draw each leg; with two of them its name begins the pictures' names."""
    made: dict[str, Figure] = {}
    for leg, (machine, run, _) in legs.items():
        subtitle = (
            f"scenario {SCENARIO} through CAN frames, empty machine{of_leg(leg, legs)}, "
            f"plant friction {machine.law.value}; grey: at rest"
        )
        when = marks(machine.settings.trainer.excite[SCENARIO])
        open_gate = moving(run.true_velocity, machine.frictions)
        own = f"{leg}_" if len(legs) > 1 else ""
        made[f"{own}hip"] = draw_axis(run, 0, subtitle)
        made[f"{own}slide"] = draw_axis(run, 1, subtitle)
        made[f"{own}details"] = draw_details(run, when, open_gate, machine.frictions[1], subtitle)
    return made


def _delay_rows(found: tuple[Delay, Delay] | str) -> tuple[Row, ...]:
    if isinstance(found, str):
        return (Row("delay of the effort", None, None, "ms", "ms"),)
    hip, slide = (one.delay_ms if one.known else None for one in found)
    return (Row("delay of the effort", hip, slide, "ms", "ms"),)


def _gait_rows(trials: Trials, begin: Begin) -> dict[str, list[Row]]:
    made: dict[str, list[Row]] = {leg: [] for leg in trials.legs}
    for cadence_hz in CADENCES_HZ:
        title = f"gait at {cadence_hz:g} Hz"
        situation = Situation(cadence_hz=cadence_hz)
        for leg, trial in trials.gait_of_legs(situation, GAIT_S, begin(title, 1.0)).items():
            hip, slide = 100 * (1 - trial.moving[trial.judged].mean(axis=0))
            row = Row(f"{title}: time at rest", float(hip), float(slide), "%", "%")
            made[leg].append(row)
    return made
