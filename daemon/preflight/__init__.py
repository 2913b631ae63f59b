"""What is refused before anything moves: one judgement of a set of files, for every command.

`judgement.py` is asked by `gaitd check`, which shows its report, and by `gaitd core`, which starts
with nothing that the report refuses. The rules and sweeps themselves are in `daemon/config`
(`load.py` and `cross*.py`, `check*.py`, `workspace.py`, `runaway.py`) and `gateway/endpoints.py`.
"""
