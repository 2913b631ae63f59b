"""The demonstration `gaitd demo`: plays acts, shows the estimate, and evaluates its errors.

Reading order: `script.py` (the acts), `turns.py` (how time passes), `clients.py` with
`client_process.py` (pages and the assist, in the act's time), `stage.py` (files and processes of an
act), `feed.py` (data from Zenoh, and the truth of the virtual drives), `evaluation.py` (errors and
bounds), `curves.py` and `view.py` (the live view), `performance.py` (all of it together). A
training has `training_script.py` (the act), `people.py` (patient and therapist at their pages) and
`training.py` (files, and the result). At the end: `report.py` (tables), `picture.py` (the PNG).
"""
