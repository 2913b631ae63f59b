"""The fault matrix: every fault in every mode on both axes, in lock-step, checked and recorded.

Reading order:
    session                  the lock-step session of a column, with its own plant
    modes, controller        the columns: each mode, how to reach it, the controller in mode torque
    kinds, core_kinds        kinds of fault, and how each begins and ends
    faults, emergencies      the rows: all faults
    expected, exceptions     the expected result of each cell, and the reasons for exceptions
    cell, watch              one cell: started, observed, measured
    run                      all cells: one session for each mode, a fork for each cell
    evaluation               the laws that every cell is checked against
    page, heat_map           docs/fault_matrix.md and its picture
"""
