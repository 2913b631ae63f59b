"""The core as a process: the only part of it that touches clocks, the bus and the kernel.

Reading order: `process.py`, `build.py` (a core from its configuration), `loop.py` with
`loop_settings.py` and `grid.py` (the 10 ms grid), `bring_up.py`, `sync_window.py`, `commands.py`,
`shutdown.py`; `bus_link.py`, `arrivals.py`, `bus_load.py` (the bus), `realtime.py`,
`warm_up.py`, `texts.py` (English sentences), `systemd.py`, `state_file.py`.
"""
