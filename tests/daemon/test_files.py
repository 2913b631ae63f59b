"""Files that a full disk and a power cut leave whole."""

import os
import resource
from pathlib import Path

import pytest

from daemon.core.runtime.state_file import StateFile
from daemon.ipc import state_file
from daemon.keys import issuing
from daemon.keys.folder import CLIENTS, Client, Keys, Register
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


def test_a_client_that_is_revoked_and_the_first_state_file_outlive_a_power_cut(
    tmp_path, monkeypatch
):
    ward = Client(name="session.ward", password="x" * 32, remote=False, issued="2026-11-23")
    dates = {"authority_expires": "2036-11-20", "gateway_expires": "2027-11-23"}
    keys = Keys(tmp_path, Register(clients=(ward,), **dates))
    (tmp_path / CLIENTS).write_text("with the ward")
    names = []
    monkeypatch.setattr(issuing, "read_keys", lambda _folder: keys)
    monkeypatch.setattr(
        os, "fsync", lambda file: names.append(Path(f"/proc/self/fd/{file}").readlink())
    )

    issuing.revoke(tmp_path, ward.name)
    assert ward.name not in (tmp_path / CLIENTS).read_text()
    assert names.pop() == tmp_path

    for _ in range(2):
        StateFile(tmp_path / "state")
    assert (tmp_path / "state" / state_file.NAME).exists()
    assert names[1:] == [tmp_path / "state"]
