"""`gaitd honesty`: consistency of the observer's standard deviations, status bits and advice."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

if TYPE_CHECKING:
    from analysis.consistency import Band, Consistency, Drifted, Gap, Offset, Plant, Rest

RUNS: Final = 200
STEPS: Final = 400
LEVEL_RATIOS: Final = (0.8, 0.9, 0.95, 0.98, 1.0, 1.02, 1.05, 1.1, 1.2)
EXIT_REFUSED: Final = 2


def command(
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="where the picture goes", file_okay=False)
    ] = Path("out"),
    robot: Annotated[
        Path | None,
        typer.Option(help="robot.toml; by default configs/robot_empty.toml", dir_okay=False),
    ] = None,
    runs: Annotated[int, typer.Option(min=2, help="of the Monte Carlo")] = RUNS,
) -> None:
    """Measure the observer's consistency on a plant whose noise is known; print and draw it.

    Exit code 0 only if NEES and NIS are in their chi-square bands, and errors in gaps in 3 sigma.
    """
    from analysis.consistency import drifting, gaps, monte_carlo, offsets, plant_of, still
    from analysis.consistency_figure import draw
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml
    from gaitd.places import configs_folder

    file = robot or configs_folder("--robot", "robot_empty.toml") / "robot_empty.toml"
    plant = plant_of(load_toml(file, Robot))
    with _stages() as told:
        found = monte_carlo(plant, runs, STEPS, told("Monte Carlo"))
    rest, lost = still(plant), gaps(plant)
    drifted, moved = drifting(plant, LEVEL_RATIOS), offsets(plant)
    print(f"robot        {file}")
    _consistency(found, runs)
    _rest(rest, plant)
    _lost(lost)
    _drifted(drifted)
    _moved(moved)
    picture = output / "honesty.png"
    try:
        output.mkdir(parents=True, exist_ok=True)
        draw(found, rest, lost, drifted, picture)
    except OSError as error:
        print(f"{error.filename}: {error.strerror}", file=sys.stderr)
        raise typer.Exit(EXIT_REFUSED) from error
    print(f"picture      {picture}")
    within = all(max(gap.sigmas) <= 3.0 for gap in lost)
    raise typer.Exit(0 if found.nees.inside and found.nis.inside and within else 1)


def _consistency(found: "Consistency", runs: int) -> None:
    from observer.filter.states import STATE_NAMES

    print(f"Monte Carlo  {runs} runs of {STEPS} steps, both axes in motion")
    print(
        f"             {found.discarded_count} more discarded: noise carried the leg to its edges"
    )
    print(f"NEES         {_in_band(found.nees)}, 8 is ideal")
    print(f"NIS          {_in_band(found.nis)}, 2 is ideal")
    print(f"whiteness    correlation of one innovation with the next {found.correlation:+.3f}")
    print("within       1 sigma  2 sigma  3 sigma   (68.3, 95.4, 99.7 % if Gaussian)")
    for name, *shares in zip(STATE_NAMES, *found.within_ratio.tolist(), strict=True):
        print(f"  {name:<23}" + "  ".join(f"{share:7.1%}" for share in shares))


def _in_band(band: "Band") -> str:
    word = "inside" if band.inside else "OUTSIDE"
    return (
        f"{band.mean:.2f}, {word} the 95 % band of one instant {band.low:.2f}..{band.high:.2f}; "
        f"{band.inside_ratio:.0%} of the instants inside (95 % if honest)"
    )


def _rest(rest: "Rest", plant: "Plant") -> None:
    std, net = rest.estimates.std[-1], rest.estimates.net_std[-1]
    hip, slide = plant.frictions
    print("at rest      for 60 s, nobody in the machine")
    print(f"  patient, rms             {rest.patient_rms[0]:.3f} N·m, {rest.patient_rms[1]:.2f} N")
    print(f"  sigma of the split       {std[6]:.1f} N·m, {std[7]:.0f} N", end="")
    print(f" (friction holds up to {hip.stribeck:g} and {slide.stribeck:g})")
    print(f"  sigma of the net effort  {net[0]:.2f} N·m, {net[1]:.1f} N")


def _lost(lost: "list[Gap]") -> None:
    print("gaps         largest error of 22 gaps, in motion")
    for gap in lost:
        print(
            f"  {1e3 * gap.duration_s:3.0f} ms    {1e3 * gap.error[0]:6.2f} mrad = "
            f"{gap.sigmas[0]:.1f} sigma, {1e3 * gap.error[1]:6.2f} mm = {gap.sigmas[1]:.1f} sigma; "
            f"sigma grew {gap.growth[0]:.0f} and {gap.growth[1]:.0f} times at least"
        )


def _drifted(drifted: "list[Drifted]") -> None:
    print("drift        true friction levels; found by the drift monitor, empty machine in motion")
    for one in drifted:
        print(
            f"  {one.level_ratio - 1.0:+4.0%}      hip {one.friction_error[0]:+6.2f} of "
            f"{one.true_error[0]:+5.2f} N·m, correlation {one.correlation[0]:+.2f}; slide "
            f"{one.friction_error[1]:+6.1f} of {one.true_error[1]:+5.1f} N, "
            f"{one.correlation[1]:+.2f}"
        )


def _moved(moved: "list[Offset]") -> None:
    print("offset       of the hip's encoder, from one cycle on")
    for one in moved:
        print(
            f"  {one.offset_rad:.2f} rad   believed after {one.believed_after_cycles} cycles, "
            f"{'flagged' if one.flagged else 'NOT FLAGGED'}, valid again after "
            f"{one.valid_after_cycles}"
        )


@contextmanager
def _stages() -> Generator[Callable[[str], Callable[[float], None]]]:
    """Progress bar, shown only on a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:

        def stage(title: str) -> Callable[[float], None]:
            task = progress.add_task(title, total=1.0)
            return lambda done: progress.update(task, completed=done)

        yield stage
