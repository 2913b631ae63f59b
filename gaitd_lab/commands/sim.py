"""`gaitd sim`: the virtual drives of a configuration on its bus, and commands to them.

    gaitd sim --config FILE                         run them
    gaitd sim inject LINE --config FILE             a fault, such as `silent right/hip 0.5`; `help`
    gaitd sim patient NAME --config FILE            what the patient does, such as `active`

On a simulated bus the commands go to the channel of the configuration; on another one to the socket
of `gaitd sim --control`. Exit codes: 0; 1 the virtual drives refuse it; 2 usage or configuration;
4 they do not answer.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final

import typer
from gaitd_names import ExitCode
from gaitd_names.joints import JOINTS
from gaitd_toml import COMMAND_LINE, MISSING, ConfigError

from gaitd.command_line import (
    CommandError,
    ConfigFile,
    JsonLinesOption,
    full_name,
    json_on_stdout,
    with_config,
)

ANSWERED_WITHIN_S: Final = 10.0


class Action(StrEnum):
    """Subcommand of `gaitd sim`."""

    RUN = "run"
    INJECT = "inject"
    PATIENT = "patient"


def command(
    config: ConfigFile,
    action: Annotated[Action, typer.Argument(help="what to do")] = Action.RUN,
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[LINE]", help="inject: a command; patient: a programme"),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", help="CSV of what really happens, a row a SYNC")
    ] = None,
    truth_in_silence: Annotated[
        bool,
        typer.Option("--truth-in-silence", help="and a row every 10 ms while no SYNC comes"),
    ] = False,
    control: Annotated[
        Path | None,
        typer.Option("--control", help="Unix socket for faults and patient, on any bus"),
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="in place of plant.toml's")] = None,
    duration_s: Annotated[
        float | None, typer.Option("--duration", help="end by itself after so many seconds of its")
    ] = None,
    pace: Annotated[
        str | None,
        typer.Option(
            "--pace", help="of simulated time: a multiple of real time, or max  [default: 1]"
        ),
    ] = None,
    wall_clock: Annotated[
        bool, typer.Option("--wall-clock", help="a simulated bus by the computer's clock")
    ] = False,
    hold: Annotated[
        bool, typer.Option("--hold", help="simulated time stands until a hand lets it go on")
    ] = False,
    no_drives: Annotated[
        bool, typer.Option("--no-drives", help="bus and time alone: the drives are of others")
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without", help="a drive, such as right/slide, that another program stands in for"
        ),
    ] = None,
    as_json: JsonLinesOption = False,
) -> None:
    """Run the virtual drives of a configuration until SIGTERM or Ctrl-C, or send them a command."""
    from daemon.config.trainer import load_trainer
    from gaitd_lab.simulation import Options, run

    line = " ".join(words or ())
    if action is not Action.RUN:
        sent = f"patient {line}".strip()
        if action is Action.INJECT:
            sent = " ".join(_full(word, config) for word in words or ())
        with json_on_stdout(as_json) as write:
            answer = _answer(config, control, sent)
            print(answer)
            write({"sent": sent, "answer": answer})
        return
    if line:
        raise ConfigError(COMMAND_LINE, "LINE", line, "only for inject and patient")
    options = Options(
        truth=truth,
        truth_in_silence=truth_in_silence,
        control=control,
        seed=seed,
        duration_s=duration_s,
        pace=pace,
        wall_clock=wall_clock,
        hold=hold,
        no_drives=no_drives,
        without=tuple(_full(name, config) for name in without or ()),
    )
    with json_on_stdout(as_json) as write:

        def said(text: str) -> None:
            print(text, flush=True)
            write({"event": "started", "text": text})

        code = run(load_trainer(config), options, said)
        write({"event": "ended", "exit_code": code})
    raise typer.Exit(code)


def _full(word: str, config: Path) -> str:
    """Return LEG/AXIS of an axis that is named without its leg; another word is left as it is."""
    from daemon.config.trainer import drive_names, load_trainer

    if word not in JOINTS:
        return word
    return full_name(word, drive_names(load_trainer(config).trainer), "AXIS")


def _answer(config: Path, control: Path | None, line: str) -> str:
    """Send a command to the virtual drives, and return their answer."""
    from sim_drives.control import send_command

    try:
        if control is None:
            return _command_on_channel(config, line)
        answer = send_command(control, line)
    except OSError as error:
        raise _no_answer(error) from error
    if answer.startswith("error: "):
        raise _refused(answer)
    return answer.removeprefix("ok: ")


def _no_answer(error: Exception) -> CommandError:
    text = f"the virtual drives do not answer: {error}"
    following = with_config("gaitd sim")
    return CommandError(text, ExitCode.UNAVAILABLE, blame="virtual drives", following=following)


def _refused(text: str) -> CommandError:
    return CommandError(text, ExitCode.FAILED, blame="LINE", following="gaitd sim inject help")


def _command_on_channel(config: Path, line: str) -> str:
    """Send a command over the simulated bus of a configuration; return the answer."""
    from daemon.config.trainer import SIMULATED, load_trainer
    from simtime.link import LinkLostError, SocketLink
    from simtime.wire import Role

    file = load_trainer(config)
    if file.trainer.bus.interface != SIMULATED:
        allowed = f"that of `gaitd sim --control`: {config} has no simulated bus"
        raise ConfigError(COMMAND_LINE, "--control", MISSING, allowed)
    link = SocketLink(Path(file.channel), Role.HAND, "command", timeout_s=ANSWERED_WITHIN_S)
    try:
        link.open()
        return link.command(line)
    except LinkLostError as error:
        raise _no_answer(error) from error
    except ValueError as error:
        raise _refused(f"error: {error}") from error
    finally:
        link.close()
