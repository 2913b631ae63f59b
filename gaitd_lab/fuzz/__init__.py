"""The random hour: the service in lock-step among random commands and random faults, watched.

Reading order: `chances.py` (what may happen, and how often), `controller.py` (who holds the lease),
`tap.py` (the wire, with a listener and a thief on it), `invariants.py` (what must never happen,
judged from wire and truth; `stops.py`: that a stop happens; `beyond.py`: how far out a joint may
be; `assisted.py`: of a controller's assist; `watched.py`: one drive),
`session.py` (one session from its seed), `variants.py` (makes of drives and kinds of guidance),
`series.py` (session after session),
`tally.py` (what has happened, counted), `report.py` (the same, told).
"""
