"""The virtual drives in real time on a bus of their own, and python-canopen's network on it."""

import time

import pytest
from drive_bench import Bench
from outside_master import EPOS4, GENERIC, PatientNode, added, on_a_bus

from sim_drives.realtime import now_ns

PLAIN = {"personality": "generic", "eds": "drives/generic402.eds"}


@pytest.fixture
def encoder():
    return "absolute"


@pytest.fixture
def _on_a_bus(encoder):
    """Node 5 is like an EPOS4, node 6 a plain CiA 402 drive; no mechanics to speak of."""
    hip = {"encoder": encoder}
    with on_a_bus(Bench(hip=hip, slide=PLAIN | hip, start_ns=now_ns())) as parts:
        time.sleep(0.35)  # real time: boot-up and self-test
        yield parts


@pytest.fixture
def network(_on_a_bus):
    return _on_a_bus[0]


@pytest.fixture
def station(_on_a_bus):
    return _on_a_bus[1]


@pytest.fixture
def hip(network):
    return added(network, PatientNode(5, EPOS4))


@pytest.fixture
def slide(network):
    return added(network, PatientNode(6, GENERIC))
