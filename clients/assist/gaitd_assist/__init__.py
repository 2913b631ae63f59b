"""Assistance as needed: a reference controller on top of gaitd-client.

Reading order: `law.py` (the interface of a law), `phase_help.py` (guidance and assist over the
stride), `lack.py` (what a patient lacks by the estimate), `transparency.py` (friction fed forward,
optional), `leg.py` (the laws of one leg, and when they may learn), `settings.py` (the file),
`journal.py` (the log), `program.py` (the command). A further law is a file like `phase_help.py`,
named in `leg.py`.
"""

from gaitd_assist.law import Law, Memory, Sample
from gaitd_assist.leg import LegController, StrideLine
from gaitd_assist.phase_help import PhaseHelp
from gaitd_assist.settings import Settings, parse_settings, read_settings
from gaitd_assist.transparency import EnergyTank, Transparency

__all__ = [
    "EnergyTank",
    "Law",
    "LegController",
    "Memory",
    "PhaseHelp",
    "Sample",
    "Settings",
    "StrideLine",
    "Transparency",
    "parse_settings",
    "read_settings",
]
