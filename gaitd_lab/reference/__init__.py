"""The generated parts of the reference pages in docs/: messages, configuration, modes, roles.

A page is written by hand; between its comments `NAME: begin` and `NAME: end` are the tables of the
code. `python -m gaitd_lab.reference.pages docs` (`make tables`) writes them; `schemas.py` has those
of messages and files, `modes.py` of modes, `roles.py` of roles, `typescript.py` the
types of messages for the module of pages.
"""
