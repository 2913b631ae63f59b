"""Fault injection of the virtual drives.

`rules.py` (effect of each kind) and `script.py` (which drive has which fault, and when). The kinds
are in `sim_drives/settings.py`.
"""
