"""Acceptance of a drive: what `gaitd commission --report` has measured, as a record and a page.

`record.py` is the record (JSON), `stops.py` measures a stop from the records of the core, `page.py`
writes the page. The steps that move the machine are those of the service; `gaitd/acceptance.py`
requests them one after the other.
"""
