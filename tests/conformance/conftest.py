"""The virtual drives in real time on a bus of their own, and python-canopen's network on it."""

import time

import pytest
from drive_bench import Bench
from outside_master import EPOS4, GENERIC, PatientNode, added, on_a_bus

from sim_drives.realtime import now_ns

PLAIN = {"personality": "generic", "eds": "drives/generic402.eds"}


@pytest.fixture
def bench():
    """Node 5 is like an EPOS4, node 6 a plain CiA 402 drive; no mechanics to speak of."""
    return Bench(slide=PLAIN, start_ns=now_ns())


@pytest.fixture
def network(bench):
    with on_a_bus(bench) as network:
        time.sleep(0.35)  # real time: boot-up and self-test
        yield network


@pytest.fixture
def hip(network):
    return added(network, PatientNode(5, EPOS4))


@pytest.fixture
def slide(network):
    return added(network, PatientNode(6, GENERIC))
