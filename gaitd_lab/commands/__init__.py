"""The laboratory's commands, one thin file for each; only they know the command line of gaitd.

`table.py` has a line for each command, and `gaitd --help` shows them in that order; the command
line finds the table by the entry point in `gaitd_lab/pyproject.toml`. `demo_file.py` is the option
that most of them share. What a command computes is in the package of its subject.
"""
