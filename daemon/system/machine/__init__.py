"""Facts about the machine that gaitd runs on, each with a grade and a remedy, for `gaitd doctor`.

`finding.py` (fact, grade, remedy), `checks.py` (all checks in their order; software, limits, disk),
`timing.py` (kernel, clocks, processors), `can_interfaces.py` (what `ip` says of CAN interfaces).
"""
