"""Studies: what is claimed of the observer, measured on virtual machines and on recordings.

A study is a function that returns a `Report`: tables of measured quantities, and pictures
(`report.py`, which also writes them). Its command prints the tables and writes the report;
`docs/evidence/` has the last ones. `consistency/` is the filter's own model with known noise,
`real_data/` recordings of others, `ablation/` each design choice on and off, `experiment/` the
paper's Figs. 4 and 5 with its claims, `strides.py` the patient's work in gait,
`working_patients.py` patients who take part, `calibration.py` (`python -m
gaitd_lab.studies.calibration FOLDER`) a calibration with known truth.
"""
