"""Assistance as needed: a reference controller on top of gaitd-client.

Reading order: `law.py` (the interface of a law), `guidance.py` (stiffness, once a stride),
`phase_assist.py` (assist over the stride), `transparency.py` (friction fed forward, optional),
`leg.py` (the laws of one leg, and when they may learn), `settings.py` (the file), `journal.py` (the
log), `program.py` (the command). An own law is a file like `guidance.py`, named in `leg.py`.
"""

from gaitd_assist.guidance import Guidance
from gaitd_assist.law import Law, Sample
from gaitd_assist.leg import LegController, StrideLine
from gaitd_assist.phase_assist import PhaseAssist
from gaitd_assist.settings import Settings, SettingsError, parse_settings, read_settings
from gaitd_assist.transparency import EnergyTank, Transparency

__all__ = [
    "EnergyTank",
    "Guidance",
    "Law",
    "LegController",
    "PhaseAssist",
    "Sample",
    "Settings",
    "SettingsError",
    "StrideLine",
    "Transparency",
    "parse_settings",
    "read_settings",
]
