"""Time of the virtual machine.

`conductor.py` (when each seat may continue), `server.py` and `bus_server.py` (the same between
processes), `wall_clock.py` (by the computer's clock).
"""
