"""The file of the core's notes, as far as both processes know it: its name and its size.

The core writes it through a mapping (`core/runtime/state_file.py`); the gateway brings it to the
disk (`recorder/state_file_sync.py`).
"""

from typing import Final

NAME: Final = "axes.json"
"""In the state directory."""
SIZE: Final = 8192
"""Bytes; what the notes leave over is filled with spaces."""
