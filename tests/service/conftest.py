"""What the tests of real processes share: one running service, and the table of what they saw."""

import tempfile
from pathlib import Path

import pytest
from fault_table import FaultTable
from long_service import long_lived
from small_disk import mount, unmount

from gaitd_lab.processes import memory_folder

TABLE = Path(__file__).parents[2] / "docs/evidence/process_faults.md"


@pytest.fixture(scope="session")
def long_service():
    """In simulated time; `bring` takes it into the mode in which a test begins."""
    with long_lived() as service:
        yield service


@pytest.fixture(autouse=True)
def _rest(request):
    """A service that no test uses costs nothing."""
    yield
    if "long_service" in request.fixturenames:
        request.getfixturevalue("long_service").rest()


@pytest.fixture(scope="session")
def fault_table(pytestconfig):
    """Takes a row from each fault; written into docs/ with --write-process-faults."""
    table = FaultTable()
    yield table
    if pytestconfig.option.write_process_faults:
        TABLE.write_text(table.text())


@pytest.fixture
def folder():
    with tempfile.TemporaryDirectory(dir=memory_folder()) as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.fixture
def small(folder):
    """Makes a tmpfs in the folder: `small("state", "1m", "ro")`."""
    mounted = []

    def make(name, size, *options):
        mount(folder / name, size, *options)
        mounted.append(folder / name)
        return folder / name

    yield make
    for place in mounted:
        unmount(place)
