"""Files that a full disk and a power cut leave whole."""

import resource
from pathlib import Path

import pytest

from daemon.system.files import replace_file


def test_a_disk_that_takes_a_part_leaves_the_file_of_before(tmp_path):
    path = tmp_path / "clients.json"
    replace_file(path, b"before")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    open_count = len(list(Path("/proc/self/fd").iterdir()))
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            replace_file(path, b"more than ten bytes")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

    assert path.read_bytes() == b"before"
    assert len(list(Path("/proc/self/fd").iterdir())) == open_count
    replace_file(path, b"after")
    assert path.read_bytes() == b"after"
