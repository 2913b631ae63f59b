"""For tests, ours and those of programs around gaitd: a pytest plugin and what stands behind it.

`plugin.py` has the fixtures (docs/integrating.md tells how to use them) and is all that imports
pytest. Behind it: `trainer.py` (virtual drives and service, and what one asks of them) on
`service.py` (their processes and witnesses) with `edits.py` (configurations with some keys
changed); `vcan.py` (a fresh SocketCAN interface); `rigs.py` (small worlds that have what this
machine lacks). Nothing of the service imports any of it.
"""
