"""Acceptance of a drive: what `gaitd commission --report` has measured, as a record and a page.

`record.py` is the record (JSON, in codes and numbers), `words.py` has its sentences, `page.py`
writes the page. The procedure is in `gaitd/commissioning`.
"""
