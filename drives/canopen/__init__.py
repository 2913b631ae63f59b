"""CANopen (CiA 301), master side: frames in and out, NMT, heartbeats, emergencies.

Reading order: `bus.py` and `simulated.py` (frames in and out), `bus_state.py` and `bus_load.py`
(what the controller reports, how full the bus is), `nmt.py`, `emcy.py` with `emcy_codes.py`,
`presence.py` (nodes that should not be there), `sniffer.py` (receive only).
"""
