"""A drive that is not the one of the files: how the process ends, and what it leaves on the bus."""

import tempfile
from pathlib import Path

import pytest
from processes import MEMORY, Service
from sessions import changed_configs

pytestmark = pytest.mark.realtime


@pytest.fixture
def folder():
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as name:
        yield Path(name)


def test_a_wrong_product_ends_the_core_with_3_and_both_numbers_and_starts_no_drive(folder):
    configs = changed_configs(folder, ("drives/hip_epos4.toml", "0x61500000", "0x65510000"))
    service = Service(folder, configs)
    try:
        service.start_drives()
        with service.listener() as bus:
            core = service.start("core")
            service.wait(lambda: core.poll() is not None, 60)
            sent = []
            while (message := bus.recv(0.2)) is not None:
                sent.append((message.arbitration_id, bytes(message.data)))
    finally:
        service.end()

    said = service.log("core").splitlines()[-1]
    assert core.returncode == 3
    assert "wrong product (CiA 302 M): drive right/hip 1018h:02 = 61500000h" in said
    assert "expected 65510000h" in said
    assert not [data for can_id, data in sent if can_id == 0x000 and data[0] == 0x01]
    assert not [can_id for can_id, _ in sent if can_id in {0x205, 0x206, 0x305, 0x306}]
