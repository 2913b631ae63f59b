"""The gateway: everything that a network can reach, and nothing that can reach the CAN bus.

Reading order: `process.py` (the loop), `service.py` (one turn of it), `leg_messages.py` (a leg's
estimate before all else), `translate.py` (what may be shown), `requests.py` (requests of clients),
`lease.py`, `setpoints.py` and `steering.py` (which client may command torque), `presence.py` (does
the core send), `events.py`, `emergencies.py`, `strides.py` and `health.py` (what is made from many
records), `outlet.py` (where messages go), `reload.py` (SIGHUP), `log.py`. Zenoh itself is in
`daemon/zenoh_io/`, what is kept on disk in `daemon/recorder/`.
"""
