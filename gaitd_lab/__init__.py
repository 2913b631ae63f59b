"""The laboratory: lock-step sessions, fault matrix, random sessions, soak, demonstration, benches.

It needs the virtual drives, and nothing of the service imports it. `gaitd.testing` is the part that
other projects use in their tests.
"""
