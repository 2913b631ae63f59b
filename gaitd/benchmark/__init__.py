"""What `gaitd bench` measures; each as a ratio or a share within one run.

Reading order: `scaling.py` (growth with legs and recordings, allocations), `cycle_parts.py` (Python
time of one cycle), `lateness.py` (SYNC in real time), `replay_speed.py` (recordings), `tables.py`
(for people). The observer's step against C and FilterPy is measured by `benchmarks/` of the
repository, which is not installed.
"""
