"""The fault matrix: every fault in every mode on both axes, in lock-step, judged and written down.

Reading order:
    bench, gateway           a service and a machine in which anything can go wrong
    modes, controller        the columns: each mode, how to get there, who steers in mode torque
    kinds, core_kinds        what a fault is, and how it begins and ends
    faults, emergencies      the rows: each of them
    expected, exceptions     what is right in which cell, and why where it is not the usual
    cell, watch              one cell: begun, watched, measured
    run                      all cells: one session for each mode, a fork for each cell
    judgement                the laws that every cell is held to
    page, heat_map           docs/fault_matrix.md and its picture
"""
