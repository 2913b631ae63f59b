"""CANopen (CiA 301), slave side: one node from its object dictionary to its frames.

Reading order: `context.py`, `line.py`, `objects.py` (indices), `dictionary.py`, `nmt.py`,
`heartbeat.py`, `sync.py`, `emergency.py`, `storage.py` and `timers.py`; SDO: `sdo_server.py`,
`sdo_segments.py`, `sdo_block.py`, `aborts.py`; PDO: `pdo_channel.py`, `pdo_receive.py`,
`pdo_transmit.py`, `pdo_rules.py`, `cob_id.py`.
"""
