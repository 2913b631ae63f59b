"""The gateway: everything that a network can reach, and nothing that can reach the CAN bus.

Reading order: `service.py` (one turn of the loop), `leg_messages.py` (a leg's estimate before all
else), `translate.py` (what may be shown), `control.py` (requests), `lease.py`, `setpoints.py` and
`steering.py` (who may command torque), `alive.py`, `events.py`, `emergencies.py`, `strides.py` and
`health.py` (what is made from many records), `keeper.py` with `blackbox.py` (what is kept around
each stop, by `trail.py`, on `shelf.py`) and `request_log.py` (who asked for what, by
`request_chain.py` and `request_file.py`), then the outside: `access.py` (who may say what),
`endpoints.py`, `session.py`, `outlet.py`, `publish.py` and `subscribe.py` (Zenoh), `notes_disk.py`
(fsync) and `disk.py` in threads of their own (`worker.py`), `log.py` (journal or stderr),
`reload.py` (SIGHUP),
`process.py` (the loop itself).
"""
