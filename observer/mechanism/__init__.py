"""The leg as a mechanism, and its friction laws.

Reading order: `parameters.py`, `mechanism.py` (closed form), `linkage.py` (the same in pieces for
filters and plants), `friction.py`, `elementary.py` (functions without branches).
"""
