"""What all parts of one node share."""

from typing import NamedTuple

from sim_drives.canopen.dictionary import ObjectDictionary
from sim_drives.canopen.line import Line
from sim_drives.canopen.timers import Timers


class NodeContext(NamedTuple):
    """The objects of a node, its access to bus and time, and its deadlines."""

    dictionary: ObjectDictionary
    line: Line
    timers: Timers
