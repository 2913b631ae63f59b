"""What core and gateway both need of the wire contract; the messages are in `gaitd_client.wire`.

Reading order: `causes.py` with `cause_texts.py` (category and text of each stop cause),
`refusals.py` (why a setpoint is refused), `roles.py` (what each role of a client may do),
`names.py` (names of enums on the wire).
"""
