"""Verification of one drive on a bench: each fact of its profile is played and judged.

facts      what is asked, and what a drive of a profile must do
bench      one drive in a cycle of its own
measure    a motion as numbers
stages     what is played, in order
evidence   the one file with everything, signed, and its reader
"""
