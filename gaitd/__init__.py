"""The command line: `__main__.py` finds the command; one thin file for each command or family.

Families: `control.py` (enable, disable, stop, reset, mode, mark), `preparation.py` (commission,
reference, self-test), `keys.py` and `plan.py` (clients and what they may do). Shared by commands:
`command_line.py` (options, errors, files), `terminal.py` (tables and progress bars), `remote.py`
(clients of a running service). `commissioning/` has the procedures of `preparation.py`. What a
command computes is in the package of its subject.

Commands of the laboratory are in `gaitd_lab/commands`.

To add a command: a line in `COMMANDS` of `__main__.py`, and a file NAME.py with its function, or a
function in the file of its family. A new request to the service: see `daemon/__init__.py`.
"""
