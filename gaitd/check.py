"""`gaitd check`: validate a configuration without a bus, and print its values at the joint."""

import sys
from typing import Annotated

import typer
from gaitd_names import ExitCode

from gaitd.command_line import ConfigFile, JsonOption, failure
from gaitd.language import texts
from gaitd.terminal import show


def command(
    config: ConfigFile,
    json: JsonOption = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="the verdict, warnings and errors alone")
    ] = False,
) -> None:
    """Validate all that needs no bus, and print the values at the joint. Exit code 0, or 2."""
    import msgspec
    from gaitd_toml import ConfigError

    from daemon.preflight.acceptance import check_files
    from daemon.preflight.report_tables import sections, verdict

    result = check_files(config)
    report, errors = result.report, result.errors
    line = verdict(config, len(errors), report)
    if json:
        known: dict[str, object] = {"verdict": line, "errors": []}
        if errors:
            known |= failure(ConfigError.combined(errors), "check")
            known["errors"] = list(map(str, errors))
        print(msgspec.json.encode(known | (msgspec.to_builtins(report) or {})).decode())
    else:
        print(line)
    if report is not None and not json:
        if quiet:
            print("".join(f"warning: {warning}\n" for warning in report.warnings), end="")
        else:
            print()
            show(sections(report, texts()))
            print()
    if errors:
        sys.stdout.flush()
        print(ConfigError.combined(errors).lines, file=sys.stderr)
    if not json:
        print(line)
    if errors:
        raise typer.Exit(ExitCode.USAGE)
