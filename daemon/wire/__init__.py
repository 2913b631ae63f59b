"""What core and gateway both need of the wire contract; the messages are in `gaitd_client.wire`.

Reading order: `causes.py` with `cause_texts.py` (category and text of each stop cause),
`refusals.py` (why a setpoint is refused), `roles.py` (what each role of a client may do),
`report_fields.py` with `report_texts.py` (values and English text of each event and refusal of the
core), `names.py` (names of enums on the wire).
"""
