"""The core: everything between the CAN frames of one cycle and the frames of the next.

Reading order: `cycle.py` (one cycle, the whole story), then in its order `joints.py`, `safety.py`,
`modes.py`, `stopping.py`, `guidance.py` with `reference.py` and `targets.py`; `loop.py` turns them
on the 10 ms grid (`grid.py`) and the bus (`line.py`, `load_meter.py`), and `process.py` puts a core
together from its configuration. All but these are pure.
"""
