"""Errors of the recorder; each message names the file, what is wrong, and what is allowed."""


class RecordError(Exception):
    """A recording cannot be made, or not be finished."""


class FullError(RecordError):
    """There is no room for a recording: the limit of the folder, or the disk."""
