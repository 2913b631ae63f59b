"""The virtual drives in real time on a bus of their own, and python-canopen's network on it."""

import pytest
from drive_bench import booted_bench
from outside_master import PatientNode, added, eds_of, on_a_bus

PLAIN = {"personality": "generic", "eds": "drives/generic402.eds"}
ELMO = {"personality": "elmo_gold", "eds": "drives/elmo_gold.eds"}
MAKES = {"generic": PLAIN, "elmo_gold": ELMO}
"""Files of node 6, a slide."""


@pytest.fixture
def encoder():
    return "absolute"


@pytest.fixture
def make(request):
    return getattr(request, "param", "generic")


@pytest.fixture
def _on_a_bus(encoder, make):
    """Node 5 is like an EPOS4, node 6 of another make; no mechanics to speak of."""
    hip = {"encoder": encoder}
    slide = MAKES.get(make, PLAIN) | hip
    with on_a_bus(booted_bench(hip=hip, slide=slide)) as parts:
        yield parts


@pytest.fixture
def network(_on_a_bus):
    return _on_a_bus[0]


@pytest.fixture
def station(_on_a_bus):
    return _on_a_bus[1]


@pytest.fixture
def hip(network):
    return added(network, PatientNode(5, eds_of("epos4")))


@pytest.fixture
def slide(network, make):
    name = "elmo_gold" if make == "elmo_gold" else "generic402"
    return added(network, PatientNode(6, eds_of(name)))
