"""Files kept on disk: the black box around each stop, the audit log, the synced state file.

Reading order: `recorder.py` (both, as the gateway's loop uses them); `black_box.py` (records around
a stop) with `ring_follower.py` and `clip_store.py`; `audit_log.py` (requests of clients) with
`audit_file.py`; `worker.py`, `disk.py` and `state_file_sync.py` (threads that wait for a disk, so
that the gateway's loop does not).
"""
