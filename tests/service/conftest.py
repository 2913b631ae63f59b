"""What the tests of real processes share: one running service, and the table of what they saw."""

import tempfile
from pathlib import Path

import pytest
from fault_table import FaultTable
from long_service import LongService
from processes import MEMORY

TABLE = Path(__file__).parents[2] / "docs" / "process_faults.md"


@pytest.fixture(scope="session")
def long_service():
    """Runs as long as the tests do; `bring` takes it into the mode in which a test begins."""
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as folder:
        service = LongService(Path(folder))
        try:
            yield service
        finally:
            service.end()


@pytest.fixture(scope="session")
def fault_table(pytestconfig):
    """Takes a row from each fault; written into docs/ with --write-process-faults."""
    table = FaultTable()
    yield table
    if pytestconfig.option.write_process_faults:
        TABLE.write_text(table.text())
