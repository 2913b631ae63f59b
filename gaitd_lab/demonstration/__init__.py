"""The demonstration `gaitd demo`: plays scenes, shows the estimate, and evaluates its errors.

Reading order: `script.py` (the acts as generators), `stage.py` (files and processes of an
act), `feed.py` (data from Zenoh, and the truth of the virtual drives), `evaluation.py`
(errors and bounds), `pages.py` and `page_server.py` (pages of `clients/display`), `helper.py`
(help as needed), `view.py` (the live view), `picture.py` (the PNG), `performance.py` (all of it
together). A training has `training_script.py` (the act), `people.py` (patient and therapist at
their pages) and `training.py` (files, and the result).
"""
