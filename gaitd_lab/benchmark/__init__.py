"""What `gaitd bench` measures; each as a ratio or a share within one run.

Reading order: `scaling.py` (growth with legs and recordings, allocations), `cycle_parts.py` (Python
time of one cycle), `lateness.py` (SYNC in real time, also under the load of `burning.py`),
`replay_speed.py` (recordings), `whole_service.py` (start, memory, delivery beside that of
`bare_put.py`), `bus_times.py` and `peers.py` (the core beside another master), `tables.py` and
`peer_table.py` (for people). The observer's step against C and FilterPy, and the other master, are
in `benchmarks/` of the repository, which is not installed.
"""
