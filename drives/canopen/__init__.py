"""CANopen (CiA 301), master side.

`bus.py` and `simulated.py` (frames in and out), `bus_state.py` (what the controller reports),
`objects.py` (indices), `nmt.py`, `emcy.py` with `emcy_codes.py`, `sniffer.py` (receive only).
"""
