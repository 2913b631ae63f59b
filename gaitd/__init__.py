"""The command line: `__main__.py` finds the command, and one short file implements each command.

Shared by commands: `remote.py` (clients of a running service), `one_axis.py` (`commission` and
`reference`), `station.py` (`scan` and `drive`), `machine.py` (checks of `doctor`), `places.py`
(files of the project). What `demo`, `bench`, `soak`, `matrix` and `torture` run is in `gaitd_lab/`.
"""
