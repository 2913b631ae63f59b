"""Random sessions: the service in lock-step under random commands and random faults, checked.

Reading order: `event_generator.py` (possible events, and how often), `controller.py` (holder of the
lease), `lossy_world.py` (the wire, with a sniffer and frame loss), `invariants.py` (what must never
happen, checked on wire and truth; `stops.py`: that a stop happens; `position_limits.py`: how far
out a joint may be; `assisted.py`: a controller's assist; `watched_drive.py`: one drive),
`session.py` (one session from its seed), `variants.py` (makes of drives and kinds of guidance),
`series.py` (session after session),
`tally.py` (counts of events), `report.py` (the counts as text).
"""
