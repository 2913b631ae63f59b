"""What `gaitd bench` measures, one file for each kind; all as ratios or shares in one run.

Reading order: `cycle_parts.py` (Python time of one cycle), `sync_grid.py` (when SYNC leaves),
`replay_speed.py`. The observer's step and its competitors are in the repository's `benchmarks/`.
"""
