"""How often a virtual trainer is asked for a mode, by what its records say of the computer."""

import itertools

import pytest
from msgspec.structs import replace
from records import record

from gaitd.testing import trainer as module
from gaitd.testing.service import ServiceError
from gaitd.testing.trainer import TRIES, Mode, VirtualTrainer

LATE = replace(record(1).timing, lateness_ns=30_000_000)
CALM = [record(seq) for seq in range(1, 11)]
HELD_UP = [*CALM, replace(record(11), timing=LATE)]


class Asked(VirtualTrainer):
    """Comes into a mode at one try, and finds the records of a list, one after the other."""

    def __init__(self, folder, comes_at, *found):
        super().__init__(folder)
        self.tries = 0
        self.comes_at = comes_at
        self.found = itertools.chain(found, itertools.repeat(found[-1]))

    def _tried(self, mode, wanted):
        self.tries += 1
        return self.tries == self.comes_at

    def newest(self):
        return record(11)

    def records(self, after_seq=0):
        return next(self.found)


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(module, "CALM_S", 0.3)


def test_on_a_calm_computer_a_mode_that_never_comes_is_an_error_after_a_few_tries(tmp_path):
    asked = Asked(tmp_path, 100, CALM)

    with pytest.raises(ServiceError, match="never in HOLD"):
        asked.bring(Mode.HOLD)
    assert asked.tries == TRIES


def test_tries_on_a_computer_that_is_held_up_do_not_count_until_it_is_calm_again(tmp_path):
    waves = [HELD_UP, HELD_UP, CALM] * (TRIES + 2)

    assert Asked(tmp_path, TRIES + 3, *waves).bring(Mode.HOLD).tries == TRIES + 3


def test_a_computer_that_is_held_up_for_ever_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "HELD_UP_S", 3.0)
    asked = Asked(tmp_path, 100, HELD_UP)

    with pytest.raises(ServiceError, match="never in HOLD"):
        asked.bring(Mode.HOLD)
    assert TRIES < asked.tries < 100
