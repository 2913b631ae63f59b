"""Recorder of a gait trainer: messages as MCAP, estimates and the observer's inputs as Parquet.

Reading order: `program.py` (messages in, when a recording begins and ends), `recording.py` (one
recording while it is made), `columns.py` (columns of the tables, their units and meanings),
`leg_table.py` (estimates of a leg), `event_table.py`, `about.py` (what a recording says of itself),
`finish.py` (the end, also after a kill), `room.py` (limit of the folder), `disk.py`, `errors.py`.
"""

from gaitd_record.about import About, Head
from gaitd_record.errors import FullError, RecordError
from gaitd_record.finish import Finished, finish
from gaitd_record.program import (
    Begun,
    Deleted,
    Event,
    Ignored,
    Listening,
    Options,
    Purpose,
    Recorder,
    Unfinished,
    finish_leftovers,
    record,
)
from gaitd_record.recording import MESSAGES, PART, Received, Recording
from gaitd_record.room import Room, WhenFull

__all__ = [
    "MESSAGES",
    "PART",
    "About",
    "Begun",
    "Deleted",
    "Event",
    "Finished",
    "FullError",
    "Head",
    "Ignored",
    "Listening",
    "Options",
    "Purpose",
    "Received",
    "RecordError",
    "Recorder",
    "Recording",
    "Room",
    "Unfinished",
    "WhenFull",
    "finish",
    "finish_leftovers",
    "record",
]
