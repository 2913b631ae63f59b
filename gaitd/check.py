"""`gaitd check`: validate a configuration without a bus, and print its values at the joint."""

from typing import Annotated

import typer

from gaitd.command_line import ConfigFile
from gaitd.terminal import show


def command(
    config: ConfigFile,
    json: Annotated[bool, typer.Option("--json", help="the report as one JSON object")] = False,
) -> None:
    """Validate all that needs no bus, and print the values at the joint. Exit code 0, or 2."""
    import msgspec

    from daemon.preflight.acceptance import check_files
    from daemon.preflight.report_tables import sections

    _, report, refusal = check_files(config)
    if json:
        print(msgspec.json.encode(report).decode())
    else:
        show(sections(report))
    if refusal is not None:
        raise refusal
    if not json:
        print(f"\n{config}: good for one {' and one '.join(report.legs)} leg")
