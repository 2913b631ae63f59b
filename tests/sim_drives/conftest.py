"""Benches with two booted drives on a plant without mechanics."""

import pytest
from drive_bench import GENERIC, Bench


@pytest.fixture
def bench() -> Bench:
    """Two EPOS4-like drives, booted."""
    made = Bench()
    made.boot()
    return made


@pytest.fixture
def generic() -> Bench:
    """Two plain CiA 402 drives, booted."""
    made = Bench(hip=GENERIC, slide=GENERIC)
    made.boot()
    return made
