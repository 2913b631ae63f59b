"""Commissioning of a machine: the acceptance of its drives, the daily self-test, one axis.

Reading order: `messages.py` (what goes in and comes out), `procedure.py` (the procedure as a
function of state and observation; its rules), `stages.py` (the parts of a step), `plans.py` (the
steps of each command), `measures.py` and `stops.py` (what a step has shown), `objects.py` (the
objects of a drive). Around it: `run.py` (plays it, with the person at the terminal),
`remote_service.py` and `local_service.py` (what is received and requested), `report.py` (the files
of an acceptance). Sentences are made by `analysis/acceptance/words.py`, at the edge.
"""
