"""`gaitd soak`: an hour of gait by the real processes, with faults drawn from a seed.

Reading order: `happenings.py` (possible faults, and how often), `operator.py` (the simulated
operator), `witness.py` (evaluation of the records and of each stop), `memory.py`,
`passing.py` (the time), `machinery.py` (the processes), `play.py` (all of it together), `page.py`,
`figure.py`.

`gaitd fuzz` runs harder scenarios in lock-step, without clocks and processes; `gaitd matrix`
defines the expected result of each fault, and its rows are the criteria for the stops here.
"""
