"""What the tests of real processes share: one running service, and the table of what they saw."""

from pathlib import Path

import pytest
from fault_table import FaultTable
from long_service import long_lived

TABLE = Path(__file__).parents[2] / "docs" / "process_faults.md"


@pytest.fixture(scope="session")
def long_service():
    """In simulated time; `bring` takes it into the mode in which a test begins."""
    with long_lived() as service:
        yield service


@pytest.fixture(scope="session")
def timed_service():
    """The same by the computer's clock, for tests marked `realtime`."""
    with long_lived(wall_clock=True) as service:
        yield service


@pytest.fixture(scope="session")
def fault_table(pytestconfig):
    """Takes a row from each fault; written into docs/ with --write-process-faults."""
    table = FaultTable()
    yield table
    if pytestconfig.option.write_process_faults:
        TABLE.write_text(table.text())
