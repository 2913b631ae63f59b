"""IPC channel between core and gateway, and files that survive a restart: layouts and transport.

Reading order: `record.py` with `cycle_timing.py` (one cycle; the gateway
state), `report.py` (codes of events and refusals), `transport.py` (the ring of records in a file,
two datagram sockets), `ring_clip.py` (some seconds of a ring as a file of the black box),
`state_file.py` (name and size of the core's state file), `starting.py` (a core without a ring yet),
`decoding.py` (bytes from outside into structs).
"""
