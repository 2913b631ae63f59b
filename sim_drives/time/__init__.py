"""Time of the virtual drives: simulated and shared with other processes, or the computer's.

Reading order: `conductor.py` (when each seat may continue), `server.py` and `bus_server.py` (the
same between processes), `wall_clock.py` (by the computer's clock).
"""
