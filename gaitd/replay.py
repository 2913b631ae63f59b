"""`gaitd replay`: run the observer over a recorded file, as fast as possible."""

import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer
from gaitd_toml import COMMAND_LINE, MISSING, ConfigError

from analysis.replay_files import (
    ESTIMATES,
    FileError,
    Targets,
    Wanted,
    appearing,
    check,
    targets_of,
)
from gaitd.command_line import JsonOption, errors_in_one_line, json_on_stdout, robot_file
from gaitd.terminal import progress

if TYPE_CHECKING:
    from analysis.replay import Source
    from daemon.config.settings import Robot
    from daemon.ipc.record import CycleRecord
    from daemon.ipc.transport import RingHeader
    from gaitd.terminal import Update
    from observer.filter.considered import Known
    from observer.offline.batch import BatchEstimates


def command(
    recorded: Annotated[
        list[Path],
        typer.Argument(
            metavar="IN...",
            help="a .csv, a folder of `gaitd record`, a file of the black box, a ring of records",
        ),
    ],
    robot: Annotated[
        Path | None,
        typer.Option(
            help="robot.toml; by default the recording's own, for a .csv configs/robot.toml"
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(help=f"CSV of the estimates, or a folder; by default IN{ESTIMATES}"),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="draw a picture; or a folder")
    ] = None,
    leg: Annotated[str | None, typer.Option(help="of a recording; by default all its legs")] = None,
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
        Path | None, typer.Option(help="of `gaitd baseline`, taken off the estimate")
    ] = None,
    publish: Annotated[
        bool,
        typer.Option("--publish", help="do not estimate: play the messages of a ring on Zenoh"),
    ] = False,
    listen: Annotated[str, typer.Option(help="--publish: endpoint")] = "tcp/127.0.0.1:7447",
    pace: Annotated[
        float, typer.Option(min=0.01, max=100, help="--publish: a multiple of real time")
    ] = 1.0,
    repeat: Annotated[
        bool, typer.Option("--repeat", help="--publish: play it until Ctrl-C")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Run the observer over a recorded file: CSV in, CSV of the estimates out."""
    from analysis.recording import RecordingError

    with errors_in_one_line(RecordingError, FileError), json_on_stdout(as_json) as write:
        if publish:
            count = _publish(recorded, listen, pace, repeat=repeat)
            write({"published_count": count})
            return
        wanted = Wanted(output, plot, strides, strides_plot)
        write(_replay(recorded, leg, wanted, Given(robot, baseline, smooth)))


def _publish(recorded: list[Path], listen: str, pace: float, *, repeat: bool) -> int:
    """Play recordings one after the other; each time as another core, as the cycles begin anew.

    Returns: how many times they were played.
    """
    import msgspec
    import zenoh

    from analysis.recording import RecordingError
    from analysis.stop_recording import opened
    from daemon.gateway.playback import play

    tapes: list[tuple[RingHeader, list[CycleRecord]]] = []
    for path in recorded:
        with opened(path, "; only a ring of records can be published") as ring:
            tapes.append((ring.header, ring.since(0)))
        if not tapes[-1][1]:
            raise RecordingError(f"{path}: has no record")
    for count in itertools.count(1):
        for path, (header, records) in zip(recorded, tapes, strict=True):
            seconds = (records[-1].sync_mono_ns - records[0].sync_mono_ns) * 1e-9 / pace
            print(f"{path}: gaitd/{header.trainer} on {listen}, {seconds:.0f} s", flush=True)
            run = msgspec.structs.replace(header, core_boot_id=f"{header.core_boot_id}-{count}")
            try:
                play(run, records, (listen,), pace)
            except zenoh.ZError as error:
                raise RecordingError(f"--listen {listen}: {error}") from error
            except KeyboardInterrupt:
                return count - 1
        if not repeat:
            return count
    raise AssertionError("the count has no end")


class Given(NamedTuple):
    """Inputs of the estimate besides the recording."""

    robot: Path | None
    baseline: Path | None
    smooth: bool


def _replay(
    recorded: list[Path], leg: str | None, wanted: Wanted, given: Given
) -> list[dict[str, object]]:
    """Replay all recordings, after reading all: a bad one leaves every file unchanged.

    Returns: what was written from each, and its report.
    """
    from analysis.replay import legs_of, read

    chosen = [
        (path, name, len(names) > 1)
        for path in recorded
        for names in [(leg,) if leg else legs_of(path) or (None,)]
        for name in names
    ]
    results = [(path, (name or "") if several else "") for path, name, several in chosen]
    targets = targets_of(wanted, results, len(recorded) > 1)
    inputs = [path for path in (*recorded, given.robot, given.baseline) if path is not None]
    check(targets, inputs)
    with progress() as stage:
        begun_s = time.perf_counter()
        sources = [read(path, name, stage("reading")) for path, name, _ in chosen]
        reading_s = (time.perf_counter() - begun_s) / len(chosen)
        with ExitStack() as drafts:
            reports: list[dict[str, object]] = []
            lines: list[str] = []
            for source, target in zip(sources, targets, strict=True):
                output, *others = (
                    path and drafts.enter_context(appearing(path)) for path in target
                )
                draft = Targets(output or target.output, *others)
                report = list(_one(source, target, draft, given, stage, reading_s))
                lines += report
                made = source.recording
                reports.append(
                    {
                        "recording": made.source,
                        "leg": source.leg,
                        "row_count": len(made.time_s),
                        "duration_s": made.duration_s,
                        "written": target,
                        "report": report,
                    }
                )
    print("\n".join(lines))
    return reports


def _one(
    source: "Source",
    target: Targets,
    draft: Targets,
    given: Given,
    stage: "Callable[[str], Update]",
    reading_s: float,
) -> Iterator[str]:
    """Write the files of one recording; yield its report, to print once they are in place."""
    from analysis.estimates import write_csv
    from analysis.replay import estimate, estimate_smoothed, warm_up
    from analysis.replay_report import column_lines, drift_lines, recording_lines

    robot, name = _robot(source, given.robot)
    known = _known(given, robot)
    warm_up(robot, smooth=given.smooth)
    begun_s = time.perf_counter()
    run = estimate_smoothed if given.smooth else estimate
    estimates = run(source, robot, stage("estimating"), known)
    computing_s = time.perf_counter() - begun_s
    write_csv(source.recording.time_s, estimates, draft.output, stage("writing"))
    whole_s = reading_s + time.perf_counter() - begun_s
    if draft.plot is not None:
        from analysis.replay_figure import draw

        draw(source.recording, estimates, draft.plot)
    yield from recording_lines(source, estimates, name, computing_s, whole_s)
    yield from drift_lines(estimates, robot)
    yield from column_lines(source, estimates, robot)
    if draft.strides is not None or draft.strides_plot is not None:
        smooth = estimates if given.smooth else None
        del estimates  # A long recording has no room for both.
        smooth = smooth or estimate_smoothed(source, robot, stage("smoothing"), known)
        yield from _strides(source, smooth, draft, target)
    yield f"estimates    {target.output}{', smoothed' if given.smooth else ''}"
    if target.plot is not None:
        yield f"picture      {target.plot}"


def _strides(
    source: "Source", smooth: "BatchEstimates", draft: Targets, target: Targets
) -> Iterator[str]:
    """Write strides, which are always computed from the smoothed estimate."""
    from analysis.replay import columns_of
    from analysis.replay_report import stride_lines
    from analysis.stride_figure import draw
    from analysis.stride_table import write_csv
    from observer.strides import strides_of

    found = strides_of(smooth, columns_of(source))
    time_s = source.recording.time_s
    if draft.strides is not None:
        write_csv([(float(time_s[row]), stride) for row, stride in found], draft.strides)
    if draft.strides_plot is not None:
        draw(found, time_s, smooth).savefig(draft.strides_plot, format="png")
    yield from stride_lines(found, (target.strides, target.strides_plot))


def _known(given: Given, robot: "Robot") -> "Known":
    """What the baseline says; the time from it to the recording is not known."""
    from gaitd_toml import read_toml

    from daemon.config.baseline import load_baseline
    from daemon.config.robot import frictional
    from observer.baseline import LONG_AGO, known
    from observer.filter.considered import NOTHING_KNOWN

    if given.baseline is None:
        return NOTHING_KNOWN
    if given.robot is None:
        allowed = "the robot file of the baseline"
        raise ConfigError(COMMAND_LINE, "--robot", MISSING, allowed)
    sha256 = read_toml(given.robot).sha256
    return known(load_baseline(given.baseline, sha256, frictional(robot)), LONG_AGO)


def _robot(source: "Source", named: Path | None) -> "tuple[Robot, str]":
    """The robot, and a text of its origin."""
    from daemon.preflight.robot import load_robot

    if named is None and source.robot is not None:
        return source.robot, f"as the service had it, {source.leg} leg"
    path = robot_file(named, "robot.toml")
    return load_robot(path), str(path)
