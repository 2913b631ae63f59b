"""Fault injection of the virtual machine.

`rules.py` (what each kind does) and `script.py` (which drive has which, and when).
"""
