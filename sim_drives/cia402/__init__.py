"""CiA 402, slave side: the power state machine, modes, homing and limits of a virtual drive.

Reading order: `drive.py` runs `power_state.py` on one axis, with `motion.py`, `homing.py`,
`measurement.py`, `scaling.py`, `statusword.py`, `supervision.py`, `target_monitor.py`, and
`personality.py` (the differences between makes).
"""
