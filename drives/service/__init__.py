"""Service functions for an operator at the bus: scan, dump, compare, store, restore.

Reading order: `scan.py`, `stations.py` and `inventory.py` (which nodes are on a bus), `dump.py`,
`compare.py` and `eds.py` (what a drive holds and should hold), `parameters.py` (store and restore),
`proposal.py` (a profile from a maker's EDS), `bus_recording.py` (a recorded bus as samples),
`object_texts.py` and `vendors.py` (numbers as text).
"""
