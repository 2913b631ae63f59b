"""Keys: which clients may connect to the gateway, and how each proves its name.

Reading order: `folder.py` (the files, as the gateway reads them), `certificates.py` (the authority
and its certificates), `issuing.py` (init, issue, renew, revoke: the only writer of the files).
What a client presents: `gaitd_client/credentials.py`. Roles and their rights:
`daemon/wire/roles.py`.
"""
