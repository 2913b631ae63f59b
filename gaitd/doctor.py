"""`gaitd doctor`: whether this machine meets gaitd's needs, with a remedy for each lack."""

import json as json_text
from collections.abc import Iterator
from typing import Final

import typer
from gaitd_client import ClientError, Target
from gaitd_names import ExitCode

from daemon.system.machine.checks import findings
from daemon.system.machine.finding import Finding, Grade
from gaitd.command_line import JsonOption
from gaitd.remote import ConfigOption, CredentialsOption, client_of, find_target

MARKS: Final = {
    Grade.GOOD: "[green]✔[/]",
    Grade.LIMITED: "[yellow]●[/]",
    Grade.MISSING: "[blue]○[/]",
    Grade.BROKEN: "[red]✘[/]",
}
LEGEND: Final = (
    "[green]✔[/] good   [yellow]●[/] works, with a limit   "
    "[blue]○[/] not here; what needs it does not work   [red]✘[/] broken"
)


def command(
    json: JsonOption = False,
    config: ConfigOption = None,
    credentials: CredentialsOption = None,
) -> None:
    """Check what this machine can and cannot do for gaitd, and print a remedy for each lack.

    With --config or --credentials also the clients that are connected to the running service.
    """
    found = findings()
    if config is not None or credentials is not None:
        found = (*found, *_links(find_target(config, None, None, credentials)))
    if json:
        typer.echo(json_text.dumps([_as_object(finding) for finding in found], indent=2))
    else:
        _print(found)
    if any(finding.grade is Grade.BROKEN for finding in found):
        raise typer.Exit(ExitCode.FAILED)


def _links(target: Target) -> Iterator[Finding]:
    """One finding for each live link of a client, and what it matched."""
    try:
        with client_of(target, "doctor") as service:
            message = service.configuration()
    except ClientError as error:
        yield Finding("clients", str(error), Grade.MISSING, "start the service")
        return
    for name in message.keys_expiring:
        what, remedy = f"certificate of {name} ends within 30 days", f"`gaitd keys renew {name}`"
        yield Finding("keys", what, Grade.LIMITED, remedy)
    for link in message.links:
        where = f"{link.protocol}/{link.address}"
        if not message.keys:
            yield Finding("client", f"{where}: unrestricted", Grade.LIMITED, "docs/security.md")
        elif link.client is not None:
            yield Finding("client", f"{where}: certificate of {link.client}", Grade.GOOD)
        elif link.certificate is None:
            what = f"{where}: a link on this machine; Zenoh does not tell its name"
            yield Finding("client", what, Grade.GOOD)
        else:
            what = f"{where}: certificate of {link.certificate}, which is not in the register"
            yield Finding("client", what, Grade.LIMITED, "it may only stop; `gaitd keys list`")


def _as_object(finding: Finding) -> dict[str, str]:
    return {**finding._asdict(), "grade": finding.grade.value}


def _print(found: tuple[Finding, ...]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="dim")
    table.add_column("")
    table.add_column("what", no_wrap=True)
    table.add_column("here", ratio=2)
    table.add_column("what to do", ratio=2, style="dim")
    for finding in found:
        table.add_row(MARKS[finding.grade], finding.subject, finding.found, finding.remedy)
    console = Console()
    console.print(table)
    console.print(LEGEND)
