"""What core and gateway both need of the wire contract; the messages are in `gaitd_client.wire`.

Reading order: `causes.py` (category of each stop cause), `refusals.py` (why a setpoint is refused),
`roles.py` (what each role of a client may do), `report_fields.py` (values of each event, refusal
and progress of the core), `names.py` (names of enums on the wire).
"""
