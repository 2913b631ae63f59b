"""What a random session is made of, and what must never happen in it.

The sessions themselves are tests: `tests/closed_loop/test_random_sessions.py` draws their events.

Reading order: `invariants.py` (what must never happen, checked on wire and truth; `stops.py`: that
a stop happens; `position_limits.py`: how far out a joint may be; `assisted.py`: a controller's
assist; `watched_drive.py`: one drive), `build.py` (the invariants with the limits of a
configuration), `variants.py` (makes of drives and kinds of guidance), `lossy_world.py` (the wire,
with a sniffer and frame loss), `restartable_gateway.py` (a gateway that stalls and dies).
"""
