"""The command line of every program: one option parser, one form of errors, one set of exit codes.

All of it is in `program.py`. It needs typer, which the other packages of the client library do not.
"""

from gaitd_program.program import CommandError, parser, run

__all__ = ["CommandError", "parser", "run"]
