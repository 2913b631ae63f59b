"""CANopen (CiA 301), master side: frames in and out, NMT, heartbeats, emergencies.

Reading order: `frame.py`, `bus.py` (frames in and out), `bus_state.py` (what the controller
reports), `objects.py` (indices), `nmt.py`, `sdo.py`, `emcy.py` with `emcy_codes.py`, `sniffer.py`
(receive only), `data_sheet.py` (EDS and DCF files).
"""
