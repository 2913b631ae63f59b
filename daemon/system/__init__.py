"""Interfaces to the operating system.

Reading order: `clock.py` (the clocks of this computer), `bus_choice.py` (bus and clock of a
configuration), `lock.py` (one process of a kind per directory), `files.py` (files that
outlive a power cut), `descriptors.py` (whether one is free), `journal.py` and `sd_notify.py`
(systemd), `machine/` (checks for `gaitd doctor`).
"""
