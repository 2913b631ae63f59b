"""`gaitd import-candump FILE`: a recorded bus as a recording for `gaitd replay`, and as a trace.

candump -L (.log), Vector (.asc, .blf), PEAK (.trc), and python-can's .csv. The
drives are those of the trainer file: its profiles and axis files say which objects and units they
have. No bus and no service is needed. Exit codes: 0; 2 usage, configuration, or a file that gives
no recording.
"""

import csv
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drives.service.bus_recording import (
    BusRecording,
    RecordedBusError,
    Row,
    Station,
    read_bus,
)
from gaitd.command_line import (
    ConfigFile,
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
)

if TYPE_CHECKING:
    from daemon.config.bundle import LegDrives
    from gaitd.frame_file import FrameFile


def command(
    recorded: Annotated[
        Path, typer.Argument(metavar="IN", help="`candump -L`'s .log; also .asc, .blf, .csv, .trc")
    ],
    config: ConfigFile,
    output: Annotated[Path, typer.Option(metavar="CSV", help="the recording for `gaitd replay`")],
    leg: Annotated[str | None, typer.Option(help="by default the first of the trainer")] = None,
    trace: Annotated[
        Path | None,
        typer.Option(metavar="LOG", help="also the frames of these drives and their master alone"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Turn the frames of a recorded CAN bus into positions and efforts.

    Record from power-on: the SDO traffic of the start says which objects are in which frame.
    """
    with errors_in_one_line(RecordedBusError), json_on_stdout(as_json) as write:
        drives = _drives(config, leg)
        for path in (output, trace):
            if path is not None and path.exists() and path.samefile(recorded):
                raise RecordedBusError(f"{path}: is the recorded file itself; name another file")
        from gaitd.frame_file import FrameFile, FrameFileError

        frames = FrameFile(recorded)
        try:
            found = read_bus(frames, drives.hip, drives.slide)
        except FrameFileError:
            raise
        except RecordedBusError as error:
            raise RecordedBusError(f"{recorded}: {error}") from error
        notes = (*frames.notes, *found.notes)
        _write_rows(found, output)
        if trace is not None:
            _write_trace(frames, found, trace)
        told = about(found)
        for line in told.values():
            print(line)
        print(f"{len(found.rows)} rows of the {drives.name} leg in {output}")
        for note in notes:
            print(f"note: {note}")
        made = {"rows": len(found.rows), "leg": drives.name, "output": str(output)}
        write({**made, **told, "notes": notes})


def _drives(config: Path, leg: str | None) -> "LegDrives":
    from daemon.preflight.load import load

    legs = {one.name: one for one in load(config).legs}
    if leg is not None and leg not in legs:
        raise RecordedBusError(f"--leg: {leg}: {config} has {', '.join(legs)}")
    return legs[leg or next(iter(legs))]


def _write_rows(found: BusRecording, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Row._fields)
        writer.writerows(
            ["" if math.isnan(value) else repr(value) for value in row] for row in found.rows
        )


def _write_trace(frames: "FrameFile", found: BusRecording, path: Path) -> None:
    """Lines of `candump -L` with T of the master and R of the drives, from time 0."""
    drives = found.hip.from_drive | found.slide.from_drive
    directions = dict.fromkeys(found.hip.to_drive | found.slide.to_drive, "T")
    directions |= dict.fromkeys(drives, "R")
    first_s: float | None = None
    with path.open("w", encoding="utf-8") as file:
        for frame in frames:
            direction = directions.get(frame.can_id)
            if direction is None:
                continue
            first_s = frame.time_s if first_s is None else first_s
            data = frame.data.hex().upper()
            stamp = f"({frame.time_s - first_s:.6f})"
            file.write(f"{stamp} can0 {frame.can_id:03X}#{data} {direction}\n")


def about(found: BusRecording) -> dict[str, str]:
    """What was read, by part; one line each."""
    rows = found.rows
    period_ms = 1e3 * (rows[-1].time_s - rows[0].time_s) / max(len(rows) - 1, 1)
    told = {"sync": f"SYNC: {len(rows)} rows, {period_ms:.3f} ms apart on average"}
    for name, station, missing in zip(
        ("hip", "slide"), (found.hip, found.slide), found.missing, strict=True
    ):
        told[name] = f"{name}: {_station(station)}, {missing} rows without its position"
    if found.others:
        most = sorted(found.others.items(), key=lambda item: -item[1])
        listed = ", ".join(f"{can_id:03X}h {count}" for can_id, count in most[:8])
        told["others"] = f"other frames: {listed}{', ...' if len(most) > 8 else ''}"
    return told


def _station(station: Station) -> str:
    mapped = "in the file" if any(one.of_recording for one in station.tpdos) else "the profile's"
    return f"node {station.node_id}, {station.frame_count} frames, PDO mapping {mapped}"
