"""Simulation tools: lock-step sessions, fault matrix, random sessions, soak, demonstration, bench.

They need the virtual drives, and nothing of the service imports them. `gaitd.testing` is the part
that other projects use in their tests.
"""
