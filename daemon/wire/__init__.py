"""What core and gateway both need of the wire contract; the messages are in `gaitd_client.wire`.

Reading order: `causes.py` (category of each stop cause), `roles.py` (what each role of a client may
do), `report_fields.py` (values of each event, refusal and progress of the core), `printable.py`
(text of others in one line).
"""
