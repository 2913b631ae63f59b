"""Test support for this project and for programs around gaitd: a pytest plugin and its parts.

`plugin.py` has the fixtures (docs/integrating.md describes their use) and is the only file that
imports pytest. Its parts: `trainer.py` (virtual drives and service, and requests to them) on
`service.py` (their time and their output; the processes are those of `gaitd_lab/processes.py`);
`vcan.py` (a fresh SocketCAN interface);
`rigs.py` (environments with features that this machine lacks). Nothing of the service imports any
of it.
"""
