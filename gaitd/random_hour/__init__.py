"""The random hour: the service in lock-step among random commands and random faults, watched.

Reading order: `chances.py` (what may happen, and how often), `tap.py` (the wire, with a listener
and a thief on it), `invariants.py` (what must never happen, judged from wire and truth),
`session.py` (one session from its seed), `variants.py` (makes of drives and kinds of guidance),
`series.py` (session after session),
`tally.py` (what has happened, counted), `report.py` (the same, told).
"""
