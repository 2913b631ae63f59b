"""The demonstration: what `gaitd demo` plays, shows and judges.

Reading order: `script.py` (the acts, as one reads a play), `stage.py` (files and processes of an
act), `feed.py` (what comes over Zenoh, and the truth of the virtual drives), `judgement.py`
(errors and bounds), `view.py` (the live view), `picture.py` (the PNG), `performance.py` (all of it
together).
"""
