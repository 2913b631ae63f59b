"""`gaitd soak`: an hour of gait by the real processes, with faults drawn from a seed.

Reading order: `fault_generator.py` (possible faults, and how often), `operator.py` (the simulated
operator), `record_monitor.py` (evaluation of the records and of each stop), `memory.py`,
`time_control.py` (the time), `soak_processes.py` (the processes), `run.py` (all of it together),
`page.py`, `figure.py`.

`gaitd fuzz` runs harder scenarios in lock-step, without clocks and processes; `gaitd matrix`
defines the expected result of each fault, and its rows are the criteria for the stops here.
"""
