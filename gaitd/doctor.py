"""`gaitd doctor`: whether this machine meets gaitd's needs, with a remedy for each lack."""

import json as json_text
from typing import Annotated, Final

import typer

from daemon.system.machine.checks import findings
from daemon.system.machine.finding import Finding, Grade

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
    json: Annotated[bool, typer.Option("--json", help="print one JSON object")] = False,
) -> None:
    """Check what this machine can and cannot do for gaitd, and print a remedy for each lack."""
    found = findings()
    if json:
        typer.echo(json_text.dumps([_as_object(finding) for finding in found], indent=2))
    else:
        _print(found)
    if any(finding.grade is Grade.BROKEN for finding in found):
        raise typer.Exit(1)


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
