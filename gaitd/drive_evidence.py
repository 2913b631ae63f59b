"""`gaitd drive evidence FILE`: what `gaitd drive verify` has found, if nothing in it was changed.

Exit codes: 0 every fact passed or was not measured; 1 one failed; 2 usage, or no such file, or one
that was changed.
"""

from pathlib import Path
from typing import Annotated

import msgspec
import typer
from gaitd_names import ExitCode

from drives.verification import evidence
from drives.verification.facts import Judgement
from gaitd.command_line import CommandError, JsonOption, errors_in_one_line, json_on_stdout
from gaitd.terminal import show
from gaitd.verification_page import counts, row


def command(
    file: Annotated[Path, typer.Argument(metavar="FILE", dir_okay=False)],
    json: JsonOption = False,
) -> None:
    """Show the facts of an evidence file, after its digests and its signature have been checked."""
    with errors_in_one_line():
        try:
            result, key = evidence.read(file)
        except evidence.EvidenceError as error:
            raise CommandError(str(error), ExitCode.USAGE, blame=str(file), following="") from error
    with json_on_stdout(json) as write:
        title = f"{result.drive} (node {result.node_id}), {result.profile}, {result.utc}"
        show(((title, ("fact", "found", "allowed", ""), tuple(map(row, result.facts))),))
        if result.is_simulated:
            print("time was simulated: virtual drives")
        print(f"{counts(result.facts)}; unchanged since it was signed by key {key}")
        write({"result": msgspec.to_builtins(result), "key": key})
    if any(fact.judgement is Judgement.FAILED for fact in result.facts):
        raise typer.Exit(ExitCode.FAILED)
