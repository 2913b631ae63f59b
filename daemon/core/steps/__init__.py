"""The steps of a cycle that change the core's state, in the order of `cycle.py`.

Each is the only writer of its part of the state, or makes a slice of it, a frozen value that
`cycle.py` keeps for the next cycle (`tests/daemon/core/test_state_writers.py`).
Reading order: `sensing.py` (drive samples become joints) with `sampling.py`, `monitors.py` (what is
monitored over more than one cycle), `controllers.py` (a controller's setpoints), `checking.py`
(what the safety checks read), `estimation.py` (the observers), `passive.py` (the minute with a
passive patient), `supervisor.py` (verdicts and requests become modes and stops) with `requests.py`,
`exercises.py` (the exercise of each leg), `single_axis.py` (homing and sign tests) and
`persistence.py` (what outlives the core),
`impedance.py` and `targets.py` (the commands to each drive), `bring_up.py` (from OFF to READY).
`wanted.py` and `status.py` only read: what each drive should do, and what is published about it.
"""
