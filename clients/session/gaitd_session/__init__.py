"""A training session of a patient at home, on top of gaitd-client.

Reading order: `profile.py` (what the therapist sets), `plan.py` (the blocks), `machine.py` (the
state machine, pure, as a table), `goals.py` and `steps.py` (the target band, and steps against it),
`advice.py` and `view.py` (what a display shows), `store.py` (the history), `session.py` (a session
with a trainer), `export.py`, `report.py`, `program.py` and `terminal.py` (the command).
"""

from gaitd_session.advice import Advice, Failure, Why
from gaitd_session.goals import Band
from gaitd_session.machine import Button, Phase
from gaitd_session.plan import Block, BlockKind, blocks_of, limits_of
from gaitd_session.profile import Profile, parse_profile, read_profile
from gaitd_session.session import Session, SessionError
from gaitd_session.steps import Result, Step, StrideShare, step_of, works_against
from gaitd_session.store import (
    GoalSummary,
    History,
    SessionSummary,
    Store,
    StoreError,
    open_history,
)
from gaitd_session.view import BlockView, LegView, View

__all__ = [
    "Advice",
    "Band",
    "Block",
    "BlockKind",
    "BlockView",
    "Button",
    "Failure",
    "GoalSummary",
    "History",
    "LegView",
    "Phase",
    "Profile",
    "Result",
    "Session",
    "SessionError",
    "SessionSummary",
    "Step",
    "Store",
    "StoreError",
    "StrideShare",
    "View",
    "Why",
    "blocks_of",
    "limits_of",
    "open_history",
    "parse_profile",
    "read_profile",
    "step_of",
    "works_against",
]
