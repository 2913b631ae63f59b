"""`gaitd drive profile MAKER.eds`: a drive profile proposed from a maker's data sheet.

The proposal is a complete profile file, each line with its source, its questions above. It serves
`gaitd check` and virtual drives; no drive may be used with it before the questions are answered.
Exit codes: 0 the service could use the drive; 1 it could not, and the proposal says why; 2 usage,
or a file that cannot be read or written.
"""

from pathlib import Path
from typing import Annotated

import typer
from gaitd_names import ExitCode
from gaitd_toml import COMMAND_LINE, ConfigError

from drives.errors import DescriptionError
from drives.service.eds import load_eds
from gaitd.command_line import JsonOption, json_on_stdout


def command(
    eds: Annotated[Path, typer.Argument(metavar="MAKER.eds", help="EDS or DCF", dir_okay=False)],
    node_id: Annotated[int, typer.Option("--node", min=1, max=127, help="for $NODEID")] = 1,
    output: Annotated[
        Path | None, typer.Option("--output", help="profile file instead of stdout", dir_okay=False)
    ] = None,
    json: JsonOption = False,
) -> None:
    """Propose a drive profile from a maker's EDS, with what must be found out on the drive."""
    from drives.service.proposal import as_toml, propose

    try:
        sheet = load_eds(str(eds), node_id)
    except DescriptionError as error:
        raise ConfigError(str(eds), "", "", error.allowed, following="") from error
    proposal = propose(sheet, eds.name, node_id)
    text = as_toml(proposal, eds.name)
    if output is not None:
        try:
            output.write_text(text, encoding="utf-8")
        except OSError as error:
            allowed = f"a file that can be written ({error.strerror})"
            raise ConfigError(COMMAND_LINE, "--output", output, allowed) from error
    with json_on_stdout(json) as write:
        print(
            text.rstrip()
            if output is None
            else _summary(output, proposal.obstacles, proposal.questions)
        )
        write(
            {
                "profile": text,
                "obstacles": proposal.obstacles,
                "questions": proposal.questions,
                "identity": proposal.identity,
            }
        )
    if proposal.obstacles:
        raise typer.Exit(ExitCode.FAILED)


def _summary(output: Path, obstacles: tuple[str, ...], questions: tuple[str, ...]) -> str:
    counts = f"{output}: {len(questions)} questions, {len(obstacles)} obstacles"
    return "\n".join((counts, *(f"cannot be used: {one}" for one in obstacles)))
