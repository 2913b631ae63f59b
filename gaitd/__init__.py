"""The command line: `__main__.py` finds the command, and one short file implements each command.

Support of the larger commands: `demonstration/` (scenes, view and checks of `demo`), `benchmark/`
(measurements of `bench`), `machine.py` (checks of `doctor`), `remote.py` (shared by the clients of
a running service), `one_axis.py` (shared by `commission` and `reference`), `station.py` (shared by
`scan` and `drive`). `virtual_machine.py` builds the virtual drives of a configuration.
`lockstep.py` runs the product's own loop against them, faster than real time, for tests and
benchmarks.
"""
