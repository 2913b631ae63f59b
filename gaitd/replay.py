"""`gaitd replay`: run the observer over a recorded file, as fast as possible."""

import io
import math
import sys
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from gaitd.replay_files import ESTIMATES, FileError, Targets, Wanted, appearing, check, targets_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from analysis.replay import Source
    from daemon.config.settings import Robot
    from observer.offline.batch import BatchEstimates

EXIT_REFUSED = 2


def command(
    recorded: Annotated[
        list[Path],
        typer.Argument(
            metavar="IN...", help="a .csv, a file of the black box, or a ring of records"
        ),
    ],
    robot: Annotated[
        Path | None,
        typer.Option(help="robot.toml; by default the ring's own, for a .csv configs/robot.toml"),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(help=f"CSV of the estimates, or a folder; by default IN{ESTIMATES}"),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="draw a picture; or a folder")
    ] = None,
    leg: Annotated[str | None, typer.Option(help="of a ring; by default all its legs")] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="estimates in the light of the 150 ms after them")
    ] = False,
    strides: Annotated[
        Path | None, typer.Option(metavar="CSV", help="what was done in each stride; or a folder")
    ] = None,
    strides_plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="draw the strides; or a folder")
    ] = None,
    baseline: Annotated[
        Path | None, typer.Option(help="of `gaitd baseline`, taken off the stride figures")
    ] = None,
) -> None:
    """Run the observer over a recorded file: CSV in, CSV of the estimates out."""
    from analysis.recording import RecordingError

    try:
        wanted = Wanted(output, plot, strides, strides_plot)
        _replay(recorded, leg, wanted, Given(robot, baseline, smooth))
    except (RecordingError, FileError) as error:
        print(error, file=sys.stderr)
        raise typer.Exit(EXIT_REFUSED) from error
    except OSError as error:
        print(f"{error.filename}: {error.strerror}", file=sys.stderr)
        raise typer.Exit(EXIT_REFUSED) from error


class Given(NamedTuple):
    """Inputs of the estimate besides the recording."""

    robot: Path | None
    baseline: Path | None
    smooth: bool


def _replay(recorded: list[Path], leg: str | None, wanted: Wanted, given: Given) -> None:
    """Replay all recordings, after reading all: a bad one leaves every file unchanged."""
    from analysis.replay import legs_of, read

    asked = [
        (path, name, len(names) > 1)
        for path in recorded
        for names in [(leg,) if leg else legs_of(path) or (None,)]
        for name in names
    ]
    results = [(path, (name or "") if several else "") for path, name, several in asked]
    targets = targets_of(wanted, results, len(recorded) > 1)
    inputs = [path for path in (*recorded, given.robot, given.baseline) if path is not None]
    check(targets, inputs)
    with _stages() as stage:
        begun_s = time.perf_counter()
        sources = [read(path, name, stage("reading")) for path, name, _ in asked]
        reading_s = (time.perf_counter() - begun_s) / len(asked)
        with ExitStack() as drafts:
            said: list[str] = []
            for source, target in zip(sources, targets, strict=True):
                draft = Targets(
                    drafts.enter_context(appearing(target.output)),
                    target.plot and drafts.enter_context(appearing(target.plot)),
                    target.strides and drafts.enter_context(appearing(target.strides)),
                    target.strides_plot and drafts.enter_context(appearing(target.strides_plot)),
                )
                said.append(_one(source, target, draft, given, stage, reading_s))
    print("\n".join(said), end="")


def _one(
    source: "Source",
    target: Targets,
    draft: Targets,
    given: Given,
    stage: "Callable[[str], Callable[[float], None]]",
    reading_s: float,
) -> str:
    """Write the files of one recording; return its report, to print once they are in place."""
    from analysis.estimates import write_csv
    from analysis.replay import estimate, estimate_smoothed, warm_up

    robot, name = _robot(source, given.robot)
    warm_up(robot, smooth=given.smooth)
    begun_s = time.perf_counter()
    run = estimate_smoothed if given.smooth else estimate
    estimates = run(source, robot, stage("estimating"))
    computed_s = time.perf_counter()
    write_csv(source.recording.time_s, estimates, draft.output, stage("writing"))
    ended_s = time.perf_counter()
    if draft.plot is not None:
        from analysis.replay_figure import draw

        draw(source.recording, estimates, draft.plot)
    with redirect_stdout(io.StringIO()) as said:
        _report(source, estimates, name, computed_s - begun_s, reading_s + ended_s - begun_s)
        _print_drift(estimates, robot)
        if draft.strides is not None or draft.strides_plot is not None:
            _strides(source, robot, given, draft, target)
        print(f"estimates    {target.output}{', smoothed' if given.smooth else ''}")
        if target.plot is not None:
            print(f"picture      {target.plot}")
    return said.getvalue()


def _strides(
    source: "Source", robot: "Robot", given: Given, draft: Targets, target: Targets
) -> None:
    """Write strides, which are always computed from the smoothed estimate."""
    from analysis.replay import columns_of, estimate_smoothed
    from analysis.stride_figure import draw
    from analysis.stride_table import write_csv
    from observer.strides import strides_of

    passive = None if given.baseline is None else _baseline(given.baseline, given.robot)
    smooth = estimate_smoothed(source, robot)
    found = strides_of(smooth, columns_of(source), passive)
    time_s = source.recording.time_s
    if draft.strides is not None:
        write_csv([(float(time_s[row]), stride) for row, stride in found], draft.strides)
    if draft.strides_plot is not None:
        draw(found, time_s, smooth, draft.strides_plot)
    named = [str(path) for path in (target.strides, target.strides_plot) if path is not None]
    print(f"strides      {len(found)} in {' and '.join(named)}")
    if found:
        hip_j = sum(stride.hip.work_positive_j for _, stride in found) / len(found)
        slide_j = sum(stride.slide.work_positive_j for _, stride in found) / len(found)
        print(
            f"             patient's work with the motion: {hip_j:.2f} and {slide_j:.2f} J a stride"
        )


def _baseline(path: Path, robot_file: Path | None) -> "NDArray[np.float64]":
    from daemon.config.baseline import load_baseline
    from daemon.config.strict import MISSING, ConfigError, read_toml

    if robot_file is None:
        raise ConfigError("command line", "--robot", MISSING, "the robot file of the baseline")
    return load_baseline(path, read_toml(robot_file).sha256)


def _robot(source: "Source", named: Path | None) -> "tuple[Robot, str]":
    """The robot, and a text of its origin."""
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml
    from gaitd.places import configs_folder

    if named is None and source.robot is not None:
        return source.robot, f"as the service had it, {source.leg} leg"
    path = named or configs_folder("--robot", "robot.toml") / "robot.toml"
    return load_toml(path, Robot), str(path)


def _report(
    source: "Source", estimates: "BatchEstimates", robot: str, computing_s: float, whole_s: float
) -> None:
    import numpy as np

    from observer.filter.status import Status, Validity

    made = source.recording
    count = len(made.time_s)
    bad = np.count_nonzero((estimates.status & Status.VALID) == 0)
    missing = np.count_nonzero(np.isnan(made.position).any(axis=1))
    rest = np.count_nonzero(estimates.validity == Validity.SPLIT_UNOBSERVABLE, axis=0)
    nis = estimates.nis[np.isfinite(estimates.nis) & ((estimates.status & Status.GATED) == 0)]
    for title, words in source.about:
        print(f"{title:<12} {words}")
    print(f"recording    {made.source}: {count} rows, {made.duration_s:.2f} s")
    print(f"robot        {robot}")
    print(f"missing      {missing} samples")
    print(f"not valid    {bad} rows")
    print(f"at rest      hip {rest[0] / count:.1%}, slide {rest[1] / count:.1%} of the rows")
    print(f"mean NIS     {np.mean(nis):.2f} (2 is ideal)" if len(nis) else "mean NIS     -")
    print(
        f"speed        {made.duration_s / computing_s:.0f} x real time computing, "
        f"{made.duration_s / whole_s:.0f} x with reading and writing"
    )


def _print_drift(estimates: "BatchEstimates", robot: "Robot") -> None:
    """Print the drift monitor's result for the friction of each axis."""
    from analysis.consistency import drift_of
    from daemon.config.robot import friction_parameters
    from observer.drift import asks_for_calibration, correlation, friction_error
    from observer.filter.leg_model import STEP_S

    laws = friction_parameters(robot)
    units = (("hip", "N·m"), ("slide", "N"))
    found = drift_of(estimates, laws, STEP_S)
    for (axis, unit), law, drift in zip(units, laws, found, strict=True):
        rho = correlation(drift)
        if math.isnan(rho):
            print(f"friction     {axis}: too little motion to tell its level")
            continue
        print(
            f"friction     {axis}: {friction_error(drift):+.2f} {unit} from its law, correlation "
            f"with the motion {rho:+.2f}{_advice(asks_for_calibration(drift, law), robot)}"
        )


def _advice(asked: bool, robot: "Robot") -> str:
    if not asked:
        return ""
    return ": calibrate" if robot.patient is None else ": a patient, or time to calibrate"


@contextmanager
def _stages() -> Generator[Callable[[str], Callable[[float], None]]]:
    """Progress bars, one for each stage, shown only on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<12}"), BarColumn(), TaskProgressColumn())
    with Progress(
        *columns,
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:

        def stage(title: str) -> Callable[[float], None]:
            task = progress.add_task(title, total=1.0)
            return lambda done: progress.update(task, completed=done)

        yield stage
