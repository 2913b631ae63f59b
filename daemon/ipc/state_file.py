"""Name and size of the core's state file, shared by core and gateway.

The core writes it through a mapping (`core/runtime/state_file.py`); the gateway syncs it to the
disk (`recorder/state_file_sync.py`).
"""

from typing import Final

NAME: Final = "axes.json"
"""File name in the state directory."""
PAGE_SIZE: Final = 8192
"""Size of a page in bytes; the unused rest is filled with spaces."""
PAGE_COUNT: Final = 2
SIZE: Final = PAGE_COUNT * PAGE_SIZE
"""Size of the file in bytes."""
