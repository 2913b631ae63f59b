"""The steps of a cycle that change the core's state, in the order of `cycle.py`.

Reading order: `joints.py` and `sampling.py` (drive values into SI), `smoothing.py`, `monitors.py`
(what is monitored over more than one cycle), `requests.py` and `supervisor.py` (requests and
verdicts become modes and stops) with `transition.py` and `latching.py`; `exercises.py` (the
exercise of each leg), `single_axis.py` (homing and sign tests), `daily_test.py`, `controllers.py`
(a controller's setpoints); `impedance.py` and `targets.py` (the commands to each drive);
`poses.py`; `bring_up.py` (from OFF to READY).
"""
