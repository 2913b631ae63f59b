"""`gaitd blackbox`: recordings around each stop, and the log of requests.

    gaitd blackbox --config FILE             the files, newest last
    gaitd blackbox show FILE                 one stop as tables; --csv, --plot, --recording
    gaitd blackbox requests --config FILE    the request log

None of these needs a running service. Exit codes: 0; 2 usage, configuration, or a file that cannot
be read.
"""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gaitd.command_line import CONFIG_VARIABLE, JsonOption, errors_in_one_line, json_on_stdout
from gaitd.language import texts
from gaitd.terminal import show

if TYPE_CHECKING:
    from collections.abc import Iterator

    from daemon.ipc.record import CycleRecord
    from daemon.ipc.ring_clip import ClipFile


class Action(StrEnum):
    """Subcommand of `gaitd blackbox`."""

    LIST = "list"
    SHOW = "show"
    REQUESTS = "requests"


class RefusedError(Exception):
    """The command line requests something impossible; the text gives the reason."""


def command(
    action: Annotated[Action, typer.Argument(help="what to look at")] = Action.LIST,
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="show: a file of the black box, a ring")
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config", envvar=CONFIG_VARIABLE, help="trainer file: names the state directory"
        ),
    ] = None,
    state: Annotated[
        Path | None, typer.Option(help="a state directory, also a copy of one", file_okay=False)
    ] = None,
    as_json: JsonOption = False,
    export: Annotated[
        Path | None, typer.Option("--csv", help="show: write the recording for `gaitd replay`")
    ] = None,
    plot: Annotated[Path | None, typer.Option(metavar="PNG", help="show: draw it")] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--recording", help="show: write it as `gaitd record` does, with all messages"
        ),
    ] = None,
    leg: Annotated[str | None, typer.Option(help="--csv, --plot: by default the first")] = None,
    newest: Annotated[int, typer.Option("--last", min=1, help="requests: so many lines")] = 40,
) -> None:
    """Show the recordings around each stop, and which client sent which request."""
    from gaitd_toml import COMMAND_LINE, ConfigError

    from analysis.recording import RecordingError

    if folder is not None and folder.exists():
        raise ConfigError(COMMAND_LINE, "--recording", folder, "a folder that does not exist yet")
    with errors_in_one_line(RecordingError, RefusedError):
        match action:
            case Action.LIST:
                _list(_state(config, state), as_json=as_json)
            case Action.SHOW:
                _show(file, leg, (export, plot, folder), as_json=as_json)
            case Action.REQUESTS:
                _requests(_state(config, state), newest, as_json=as_json)


def _state(config: Path | None, state: Path | None) -> Path:
    if state is not None:
        return state
    if config is None:
        raise RefusedError("--config FILE or --state DIRECTORY must say where it is")
    from daemon.config.trainer import load_trainer

    return load_trainer(config).state


# --- files ----------------------------------------------------------------------------------------


def _list(state: Path, *, as_json: bool) -> None:
    import msgspec

    from daemon.ipc.ring_clip import FOLDER, clip_files

    files = clip_files(state / FOLDER)
    if as_json:
        print(msgspec.json.encode([_fields(file) for file in files]).decode())
        return
    columns = ("stopped (UTC)", "cause", "drive", "before", "after", "driven", "size", "file")
    title = f"{len(files)} {'stop' if len(files) == 1 else 'stops'} in {state / FOLDER}"
    show(((title, columns, tuple(map(_row, files))),))


def _row(file: "ClipFile") -> tuple[str, ...]:
    kept, size = file.kept, f"{file.size / 1e6:.1f} MB"
    if kept is None:
        trouble = file.trouble or "is the ring of a core"
        return ("-", trouble.removeprefix(f"{file.path}: "), *("-",) * 4, size, file.path.name)
    from analysis.stop_recording import utc_text

    period_s = file.period_ns * 1e-9
    return (
        utc_text(kept.stop_utc_ns).removesuffix(" UTC"),
        ", ".join((kept.cause, *kept.also)),
        kept.drive or "-",
        f"{(kept.stop_seq - kept.first_seq) * period_s:.1f} s",
        f"{(kept.last_seq - kept.stop_seq) * period_s:.1f} s",
        "yes" if kept.active else "no",
        size,
        file.path.name,
    )


def _fields(file: "ClipFile") -> dict[str, object]:
    import msgspec

    kept = msgspec.to_builtins(file.kept) if file.kept else None
    return {
        "file": str(file.path),
        "size_bytes": file.size,
        "core_boot_id": file.core_boot_id or None,
        "period_ns": file.period_ns or None,
        "kept": kept,
        "trouble": file.trouble,
    }


# --- one stop -------------------------------------------------------------------------------------


def _show(
    file: Path | None,
    leg: str | None,
    written: tuple[Path | None, Path | None, Path | None],
    *,
    as_json: bool,
) -> None:
    import msgspec

    from analysis.stop_recording import about, read_stop
    from analysis.stop_tables import tables, write_csv
    from daemon.gateway.events import new_events

    if file is None:
        raise RefusedError("show needs a FILE: one of `gaitd blackbox`, or a ring of records")
    stop = read_stop(file)
    one = leg or stop.header.leg_names[0]
    if one not in stop.header.leg_names:
        raise RefusedError(f"{file}: has no leg {one}, only {', '.join(stop.header.leg_names)}")
    export, plot, folder = written
    for path in (path for path in written if path is not None):
        if path.exists() and path.samefile(file):
            raise RefusedError(f"{path}: is the recording itself; name another file")
    with json_on_stdout(as_json) as write:
        said = texts()
        write({"about": dict(about(stop, said)), "kept": msgspec.to_builtins(stop.kept)})
        if not as_json:

            def events(before: "CycleRecord", now: "CycleRecord") -> "Iterator[tuple[str, str]]":
                for item in new_events(before, now):
                    text = said.report(item.code, item.subject, item.values, item.said)
                    yield said.text(f"priority.{item.priority}"), text

            show(tables(stop, events, said))
        if export is not None:
            print(f"\n{write_csv(stop, one, export)} rows of the {one} leg in {export}")
        if plot is not None:
            from analysis.stop_figure import draw

            draw(stop, one, plot, said)
            print(f"picture of the {one} leg in {plot}")
        if folder is not None:
            from gaitd.ring_export import export as write_recording

            made = write_recording(stop.header, stop.records, folder)
            print(f"{made.message_count} messages of all legs in {folder}")


# --- requests -------------------------------------------------------------------------------------


def _requests(state: Path, newest: int, *, as_json: bool) -> None:
    from daemon.recorder.audit_file import fields_of, lines_of
    from daemon.wire.printable import printable

    lines = lines_of(state)[-newest:]
    if as_json:
        print("\n".join(line.decode("utf-8", "backslashreplace") for line in lines))
        return
    rows = tuple(tuple(map(printable, _request_row(fields_of(line)))) for line in lines)
    columns = ("UTC", "", "client", "request", "outcome")
    show(((f"The newest {len(rows)} lines in {state}", columns, rows),))


def _request_row(fields: dict[str, object] | None) -> tuple[str, ...]:
    if fields is None:
        return ("-", "torn", "", "", "the line cannot be read")
    kind, at = str(fields.get("kind")), str(fields.get("utc"))[:23].replace("T", " ")
    if kind in {"asked", "answered", "summed"}:
        count = f" {fields['count']} times" if kind == "summed" else ""
        refusal = fields.get("refusal")
        reason = f": {_refusal_text(refusal)}" if refusal else ""
        what = f"{fields.get('name')}{_arguments(fields.get('payload'))}{count}"
        client = str(fields.get("client") or "-")
        return (at, kind, client, what, f"{fields.get('outcome', 'waits')}{reason}")
    known = {"utc", "kind", "core_boot_id", "cycle", "n", "before", "own"}  # three of older files
    rest = ", ".join(f"{key} {value}" for key, value in fields.items() if key not in known)
    return (at, kind, "", rest, "")


def _refusal_text(refusal: object) -> str:
    import msgspec
    from gaitd_client import wire

    try:
        return texts().refusal(msgspec.convert(refusal, wire.Refusal))
    except msgspec.ValidationError:  # of another version
        return str(refusal)


def _arguments(payload: object) -> str:
    """Arguments of a request: keys of a JSON object, or the raw text if it was not JSON."""
    if isinstance(payload, dict):
        return "".join(f" {key}={value}" for key, value in payload.items() if key != "client")
    return f" {payload!r}" if payload else ""
