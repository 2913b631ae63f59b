"""`gaitd soak`: an hour of gait by the real processes, with faults drawn from a seed.

Reading order: `happenings.py` (what can go wrong, and how often), `operator.py` (who gets the
machine walking again), `sniffer.py` (what the records show, each stop judged), `memory.py`,
`passing.py` (the time), `machinery.py` (the processes), `play.py` (all of it together), `page.py`,
`figure.py`.

`gaitd torture` asks harder questions in lock-step, without clocks and processes; `gaitd matrix`
says what is right for each fault, and its rows are what the stops are judged by here.
"""
