"""The laboratory: lock-step sessions, fault matrix, random sessions, demonstration, benches.

With the virtual drives and simulated time it is the distribution gaitd-lab, whose project file is
in this folder (`hatch_build.py` names the files of its wheel); nothing of gaitd imports it.
`commands/` has its commands, `testing/` is what other projects use in their tests. Reading order:
`virtual_machine.py` (the virtual drives of a configuration), `simulation.py` (the same on its bus:
`gaitd sim`), `lockstep.py` with `lockstep_gateway.py` (the real loop against them in one thread),
`trials.py` with `trial.py`, and `excitation.py` (recordings by lock-step, with their truth),
`studies/` (what is claimed of the observer, measured), `fault_matrix/`, `random_sessions/` (what
must never happen), `processes.py` (child processes, and those of a whole service), `requests.py`,
`demonstration/`, `timed_service.py`, `process_memory.py`, `benchmark/` with `peers/`, `sample.py`
(the shipped recording), `reference/` (tables of the reference pages in docs/).
"""
