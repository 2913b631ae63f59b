"""Measurements of `gaitd bench`; each is a ratio or a share within one run.

Reading order: `step_times.py` (times of steps), `scaling.py` (growth with legs and recordings,
allocations), `cycle_parts.py` (Python time of one cycle), `lateness.py` (SYNC in real time, also
under the load of `burning.py`), `replay_speed.py` (recordings), `whole_service.py` (start, memory,
delivery compared with `bare_put.py`), `bus_times.py` and `peers.py` (the core compared with another
master), `tables.py` and `peer_table.py` (output tables), `catalogue.py` (all of them by name). What
is compared with is in `gaitd_lab/peers`.
"""
