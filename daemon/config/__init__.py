"""Configuration: TOML files into frozen structs, every range checked, nothing defaulted.

Reading order: `settings.py` (what a file may say), `load.py` (files into `Settings`, errors that
name file, key, value and range), `check.py` (what the numbers mean at the joint).
"""
