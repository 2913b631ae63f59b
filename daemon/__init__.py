"""The service: two processes, the seam between them, configuration and the wire contract.

Reading order: `record.py`, `assist_record.py` and
`cycle_timing.py` (the words for everything), `core/` (the cycle),
`seam.py` (ring and sockets), `kept_ring.py` (files of the black box), `holding.py` (one process for
each directory), `gateway/` (Zenoh), `wire.py` with `words.py`, `leg_messages.py` and
`health_messages.py` (what programs outside rely on), `config/`, `preflight/` (what is refused
before anything starts), `cause_texts.py` and `causes.py` (each stop in words, and its category),
`refusals.py` (why a setpoint is refused), `notes_file.py` (what outlives a restart), `clock.py`,
`sd_notify.py` and `journal.py` (systemd), `bus_choice.py` and `in_step.py` (simulated time). What
comes from outside as bytes goes through `decoding.py`.
"""
