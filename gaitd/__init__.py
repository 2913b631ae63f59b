"""The command line: `__main__.py` finds the command, one thin file each does it.

Behind the larger ones: `demonstration/` (what `demo` plays, shows and judges), `benchmark/` (what
`bench` measures), `machine.py` (what `doctor` looks at), `remote.py` (what the commands that talk
to a service share), `one_axis.py` (the same of `commission` and `reference`), `station.py` (of
`scan` and `drive`). `virtual_machine.py` builds the virtual drives of a configuration, and
`lockstep.py` runs the product's own loop against them, faster than time: for tests and benchmarks.
"""
