"""The command `gaitd-session`: new-profile, run, summary, report, export, erase.

Exit code 3: the session was left, and the drives may be on.
"""

import datetime
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final

import typer
from gaitd_client import ClientError, CredentialsError, MonotonicClock, Trainer
from gaitd_client.signals import ignore_ends, interrupted_once
from gaitd_names import ExitCode
from gaitd_program import CommandError, parser
from gaitd_program import run as run_program
from gaitd_texts import Catalogue, Reader, catalogue
from gaitd_toml import ConfigError

from gaitd_session import terminal
from gaitd_session.export import ExportError, export
from gaitd_session.plan import limits_of
from gaitd_session.profile import (
    PROFILE_VERSION,
    Profile,
    new_id,
    parse_profile,
    read_profile,
)
from gaitd_session.report import ReportError, report
from gaitd_session.session import Session, SessionError
from gaitd_session.store import Store, StoreError, files_aside, open_history
from gaitd_session.terminal import NoTerminalError

EXIT_CODES: Final[Mapping[type[Exception], ExitCode]] = {
    **dict.fromkeys(
        (StoreError, ExportError, ReportError, NoTerminalError, CredentialsError), ExitCode.USAGE
    ),
    **dict.fromkeys((ClientError, SessionError), ExitCode.UNAVAILABLE),
}
HISTORY: Final = "history.sqlite"
NS_PER_S: Final = 1_000_000_000
SECONDS_PER_MINUTE: Final = 60

ProfileFile = Annotated[
    Path, typer.Option("--profile", help="TOML file of the patient", dir_okay=False)
]
HistoryFile = Annotated[
    Path | None,
    typer.Option("--history", help=f"by default {HISTORY} beside the profile", dir_okay=False),
]

app: Final = parser(
    "gaitd-session", "A training session of a patient at home, by a plan of the therapist."
)

TEMPLATE: Final = """\
# Profile of one patient for gaitd-session. The id is random: this file holds no name and no birth
# date. docs/session.md of gaitd explains every key; nothing has a default.
version = {version}
id = "{id}"
legs = ["{legs}"]

[range]                          # the gaits that are allowed for this patient
cadence_min_hz = {cadence_min}
cadence_max_hz = {cadence_max}
amplitude_min_ratio = {amplitude_min}
amplitude_max_ratio = {amplitude_max}

[assist]                         # cap of a controller; the core enforces that of the released plan
hip.max_nm = {hip_max}
slide.max_n = {slide_max}

[goal]                           # target band of the patient's share of a stride's work
share_min_ratio = {share_min}    # bounds of the band's middle
share_max_ratio = {share_max}
share_start_ratio = {share_min}
band_width_ratio = 0.1
challenge_ratio = 0.02           # the band is led so much above what the patient did
step_max_ratio = 0.05            # and moves by at most so much from a block to the next
in_band_goal_ratio = 0.6         # goal of a block: so many strides in the band

{passive}[plan.warm_up]
duration_s = {warm_up}
cadence_hz = {cadence_min}
amplitude_ratio = {amplitude_min}
rest_s = {rest}
"""
PASSIVE: Final = """\
[plan.passive]                   # the patient relaxes: what is estimated then is taken off later
duration_s = {duration}
cadence_hz = {cadence_min}
amplitude_ratio = {amplitude_max}
rest_s = 0

"""
BLOCK: Final = """
[[plan.block]]
duration_s = {duration}
cadence_hz = {cadence_max}
amplitude_ratio = {amplitude_max}
rest_s = {rest}
"""


class Language(StrEnum):
    """Language of the texts in the terminal."""

    EN = "en"
    DE = "de"


@app.command("new-profile")
def new_profile(
    cadence: Annotated[tuple[float, float], typer.Option(help="Lowest and highest, strides/s.")],
    amplitude: Annotated[tuple[float, float], typer.Option(help="Smallest and largest, 0 to 1.")],
    share: Annotated[tuple[float, float], typer.Option(help="Bounds of the target, 0 to 1.")],
    assist: Annotated[tuple[float, float], typer.Option(help="Cap at hip in N·m, slide in N.")],
    warm_up: Annotated[float, typer.Option(help="Seconds.")],
    blocks: Annotated[int, typer.Option(help="Number of blocks after the warm-up.")],
    duration: Annotated[float, typer.Option(help="Seconds of each block.")],
    rest: Annotated[float, typer.Option(help="Seconds of rest after each block.")],
    leg: Annotated[list[str], typer.Option(help="right or left; both for two legs.")],
    folder: Annotated[
        Path, typer.Option(help="Where ID.toml is written.", file_okay=False, exists=True)
    ],
    passive: Annotated[
        float, typer.Option(help="Seconds of gait with a relaxed patient before the warm-up.")
    ] = 0.0,
) -> None:
    """Write a profile with a random id; edit the file for blocks that differ."""
    profile_id = new_id()
    values = {
        "version": PROFILE_VERSION,
        "id": profile_id,
        "legs": '", "'.join(leg),
        **dict(zip(("cadence_min", "cadence_max"), cadence, strict=True)),
        **dict(zip(("amplitude_min", "amplitude_max"), amplitude, strict=True)),
        **dict(zip(("share_min", "share_max"), share, strict=True)),
        **dict(zip(("hip_max", "slide_max"), assist, strict=True)),
        "warm_up": warm_up,
        "duration": duration,
        "rest": rest,
    }
    minute = PASSIVE.format_map({**values, "duration": passive}) if passive else ""
    values["passive"] = minute
    file = folder / f"{profile_id}.toml"
    text = TEMPLATE.format_map(values) + BLOCK.format_map(values) * blocks
    profile = parse_profile(text, file)
    with file.open("x", encoding="utf-8") as opened:
        opened.write(text)
    limits = limits_of(profile)
    print(f"{file}: written. An operator releases its plan with")
    print(
        f"gaitd plan release --cadence {limits.cadence_max_hz:g}"
        f" --amplitude {limits.amplitude_max_ratio:g} --duration {limits.duration_max_s:g}"
        f" --hip-assist {profile.assist.hip.max_nm:g} --slide-assist {profile.assist.slide.max_n:g}"
    )


@app.command()
def run(
    profile_file: ProfileFile,
    credentials: Annotated[
        Path | None,
        typer.Option(help="folder of `gaitd keys issue`, role session", file_okay=False),
    ] = None,
    endpoint: Annotated[
        str | None, typer.Option(help="of the service; by default that of the credentials")
    ] = None,
    history_file: HistoryFile = None,
    language: Annotated[
        Language, typer.Option(help="of the texts: the page has its own button")
    ] = Language.EN,
) -> None:
    """Run a session in this terminal."""
    texts = catalogue(Reader.PATIENT, language)
    with interrupted_once():
        profile = read_profile(profile_file)
        history = open_history(_history_file(profile_file, history_file))
        try:
            with Trainer(endpoint, credentials, client="gaitd-session") as trainer:
                _check_legs(trainer, profile, profile_file)
                session = Session(trainer, profile, history, MonotonicClock())
                try:
                    with session:
                        _show(session, texts)
                except KeyboardInterrupt:
                    print(texts.text("terminal.left"))
                finally:
                    _check_off(session, texts)
        finally:
            if history.store is not None:
                history.store.close()


def _show(session: Session, texts: Catalogue) -> None:
    """Show a session; from its end on no signal keeps it from switching the drives off."""
    try:
        terminal.run(session, texts)
    finally:
        ignore_ends()
        print(texts.text("terminal.switching_off"), flush=True)


def _check_off(session: Session, texts: Catalogue) -> None:
    """Check that nothing is left on that the session has switched on.

    Raises:
        CommandError: the drives may be on.
    """
    if session.left_on:
        text = texts.text("terminal.may_be_on", reason=session.left_on)
        raise CommandError(text, ExitCode.DRIVE)
    print(texts.text("terminal.off"))


def _check_legs(trainer: Trainer, profile: Profile, file: Path) -> None:
    """Check that the trainer has the profile's legs.

    Raises:
        ConfigError: it has not.
    """
    there = trainer.configuration().leg_names
    if not set(profile.legs) <= set(there):
        raise ConfigError(file, "legs", list(profile.legs), f"this trainer has {', '.join(there)}")


@app.command()
def summary(profile_file: ProfileFile, history_file: HistoryFile = None) -> None:
    """Print a line for each session of a profile."""
    profile = read_profile(profile_file)
    with _reading(profile_file, history_file) as store:
        sessions = store.summaries(profile.id)
    print("session  begun (UTC)       end          walked  strides  valid  share  interruptions")
    for one in sessions:
        begun = datetime.datetime.fromtimestamp(one.begun_utc_ns / NS_PER_S, datetime.UTC)
        share = "–" if one.mean_share_ratio is None else f"{one.mean_share_ratio:.0%}"
        minutes, seconds = divmod(round(one.walked_s), SECONDS_PER_MINUTE)
        print(
            f"{one.number:7}  {begun:%Y-%m-%d %H:%M}  {one.end or 'goes on':11}"
            f"  {minutes:3}:{seconds:02}  {one.stride_count:7}  {one.valid_count:5}  {share:>5}"
            f"  {one.interruption_count:13}"
        )


@app.command("report")
def report_command(
    profile_file: ProfileFile,
    output: Annotated[Path, typer.Option(help=".html, complete in itself", dir_okay=False)],
    session: Annotated[
        int | None, typer.Option(help="number in `summary`; by default the newest")
    ] = None,
    language: Annotated[Language, typer.Option(help="of the page")] = Language.EN,
    history_file: HistoryFile = None,
) -> None:
    """Write a session as a page to read, print or keep."""
    profile = read_profile(profile_file)
    with _reading(profile_file, history_file) as store:
        page = report(store, profile, session, catalogue(Reader.OPERATOR, language))
    output.write_text(page, encoding="utf-8")
    print(f"{output}: open it in a browser, which also prints it or saves it as PDF")


@app.command("export")
def export_command(
    profile_file: ProfileFile,
    output: Annotated[Path, typer.Option(help=".csv, or .parquet with pyarrow", dir_okay=False)],
    history_file: HistoryFile = None,
) -> None:
    """Write all strides of a profile, one line each."""
    profile = read_profile(profile_file)
    with _reading(profile_file, history_file) as store:
        rows = store.strides(profile.id)
    export(rows, output)
    print(f"{output}: {len(rows)} strides")


@app.command()
def erase(
    profile_file: ProfileFile,
    history_file: HistoryFile = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Delete a profile, and everything that the history has of it."""
    profile = read_profile(profile_file)
    file = _history_file(profile_file, history_file)
    if not yes:
        typer.confirm(f"Delete {profile_file} and its sessions in {file}?", abort=True)
    count = 0
    if file.exists():
        with Store(file, is_writer=True) as store:
            count = store.erase(profile.id)
    profile_file.unlink()
    print(f"{profile.id}: {count} sessions and the profile are deleted")
    for aside in files_aside(file):
        print(f"{aside} could not be read once, and may hold sessions of this profile: delete it")


def _history_file(profile_file: Path, history_file: Path | None) -> Path:
    return history_file or profile_file.with_name(HISTORY)


@contextmanager
def _reading(profile_file: Path, history_file: Path | None) -> Generator[Store]:
    with Store(_history_file(profile_file, history_file), is_writer=False) as store:
        yield store


def main() -> None:
    """Entry point of the script."""
    run_program(app, EXIT_CODES)
