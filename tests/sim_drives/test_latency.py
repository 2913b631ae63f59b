"""S18: when in the window, and in which order, TPDOs come does not change what the master does."""

import pytest
from sessions import changed_configs, new_session

TPDOS = (0x185, 0x285, 0x186, 0x286)


def jittery(folder):
    """TPDOs anywhere in the first millisecond after their SYNC, in any order."""
    return changed_configs(
        folder,
        ("plant.toml", "tpdo_delay_min_ms = 0.05 ", "tpdo_delay_min_ms = 0.0 "),
        ("plant.toml", "tpdo_delay_max_ms = 0.25", "tpdo_delay_max_ms = 1.0"),
        ("plant.toml", "tpdo_shuffled = false", "tpdo_shuffled = true"),
    )


class Listening:
    """A session, and all TPDOs that its drives have sent."""

    def __init__(self, configs=None):
        self.session = new_session(configs) if configs else new_session()
        self.heard = []
        bus = self.session.bus
        receive = bus.receive_until

        def receive_until(deadline_ns, clock):
            frames = receive(deadline_ns, clock)
            self.heard += [frame for frame in frames if frame.can_id in TPDOS]
            return frames

        bus.receive_until = receive_until
        self.session.walk(duration_s=3.0)

    def orders(self):
        """In which orders the four answers to a SYNC have come."""
        ids = [frame.can_id for frame in self.heard]
        return {tuple(ids[at : at + 4]) for at in range(0, len(ids) - 3, 4)}

    def commands(self):
        return [(frame.can_id, bytes(frame.data)) for frame in self.session.bus.sent]

    def estimates(self):
        """As text: what is not known yet is nan, which equals nothing."""
        return [repr(record.legs[0].axes) for record in self.session.records if record.legs]


@pytest.fixture(scope="module")
def calm():
    return Listening()


@pytest.fixture(scope="module")
def shaken(tmp_path_factory):
    return Listening(jittery(tmp_path_factory.mktemp("jitter")))


def test_the_answers_do_come_in_other_orders_and_at_other_times(calm, shaken):
    assert len(shaken.orders()) > 10 > len(calm.orders())
    assert max(frame.time_ns % 10_000_000 for frame in shaken.heard) > 900_000


def test_the_master_sends_the_same_frames_whatever_the_latency_and_order(calm, shaken):
    assert len(calm.commands()) > 2000
    assert shaken.commands() == calm.commands()


def test_the_master_estimates_the_same_whatever_the_latency_and_order(calm, shaken):
    assert len(calm.estimates()) > 500
    assert shaken.estimates() == calm.estimates()
