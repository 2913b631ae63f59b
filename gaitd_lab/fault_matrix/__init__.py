"""The fault matrix: every fault in every mode on both axes, in lock-step, checked and recorded.

Reading order:
    session                  the lock-step session of a column, with its own plant
    modes, controller        the columns: each mode, how to reach it, the controller in mode torque
    kinds, core_kinds        kinds of fault, and how each begins and ends
    law                      what must happen in a cell
    faults, exceptions       the table: each fault and what is right; the cells that differ, and why
    pairs                    two faults in one cell
    cell, watch              one cell: started, observed, measured
    run                      all cells: one session for each mode, a fork for each cell
    evaluation               the laws that every cell is checked against
    reversals                bounds of each real reversal of a motor or an encoder
    page                     docs/evidence/fault_matrix.md
"""
