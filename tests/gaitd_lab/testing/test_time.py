"""A test owns the time of its virtual trainer: it holds it, lets it pass, and counts in it."""

import time

import pytest
from gaitd_names import Cause, Mode

from gaitd_lab.processes import ServiceError
from gaitd_lab.testing.trainer import virtual_trainer

NODES = (5, 6)
MASTER_HEARTBEAT, EMERGENCY = 0x701, 0x080
LIFE_GUARD = 0x8130
DETECTION_MS, PERIOD_MS = 100, 10
"""demo.toml."""
SILENT_CYCLES = 3
"""limits.toml."""


@pytest.fixture(scope="module")
def trainer():
    with virtual_trainer({"demo.toml": {"gait.announce_s": 0.5}}) as made:
        yield made


@pytest.fixture
def holding(trainer):
    trainer.enable()
    return trainer


def ms_after(frames, begin, first):
    """From the last frame with one identifier to the first with another."""
    end_ms = next(ms for can_id, ms in frames if can_id == first)
    return end_ms - max(ms for can_id, ms in frames if can_id == begin and ms < end_ms)


def test_time_that_is_held_stands_still_and_a_request_is_refused_instead_of_waiting_for_ever(
    holding,
):
    with holding.held():
        before, seq = holding.clock.now_ns(), holding.newest().seq
        time.sleep(0.1)
        with pytest.raises(ServiceError, match="control/status is asked while time is held"):
            holding.request("status")

        assert (holding.clock.now_ns(), holding.newest().seq) == (before, seq)
    assert holding.request("status")["safety"]["mode"] == "hold"


def test_exactly_so_much_time_passes_and_all_is_computed_then(holding):
    with holding.held():
        before, seq = holding.clock.now_ns(), holding.newest().seq
        holding.run(0.25)
        holding.run(0.000001)

        assert holding.clock.now_ns() == before + 250_001_000
        assert abs(holding.newest().seq - (seq + 25)) <= 1  # a record comes with its samples


def test_a_fault_at_an_instant_is_judged_in_an_exact_cycle(holding):
    with holding.held():
        now_ns = holding.newest().sync_mono_ns
        first = (now_ns - holding.clock.now_ns()) / 1e9 + 0.305  # between the SYNCs 30 and 31
        holding.at(first, "silent right/hip 0.2")
        stopping = holding.until(lambda record: record.verdict.cause != Cause.NONE)

        assert (stopping.sync_mono_ns - now_ns) / 1e6 == (30 + SILENT_CYCLES + 1) * PERIOD_MS
        assert stopping.verdict.cause == Cause.DRIVE_SILENT
        assert stopping.drives[0].sample_age_cycles == SILENT_CYCLES + 1
        holding.wait_for(Mode.FAULT)


def test_a_killed_core_is_noticed_by_each_drive_exactly_100_ms_behind_its_last_heartbeat(holding):
    with holding.listener() as bus, holding.held():
        holding.run(0.1)
        holding.kill("core")
        holding.run(0.3)
        heard = [
            (one.arbitration_id, 1e3 * one.timestamp) for one in iter(lambda: bus.recv(0), None)
        ]

    for node in NODES:
        after_ms = ms_after(heard, MASTER_HEARTBEAT, EMERGENCY + node)
        assert after_ms == pytest.approx(DETECTION_MS, abs=0.001)


def test_a_stop_while_a_mode_is_asked_for_is_an_error_at_once_with_its_cause(holding):
    holding.at(0.2, "emcy left/none - 0x2310")
    holding.at(0.6, "silent right/slide 0.5")

    with pytest.raises(ServiceError, match=r"not in GAIT but in FAULT.*DRIVE_SILENT"):
        holding.gait()
    assert "left/none" in holding.log("sim")


def test_what_does_not_come_within_its_simulated_time_is_an_error(holding):
    before_ns = holding.clock.now_ns()

    with pytest.raises(ServiceError, match="mode FAULT did not come: it is HOLD"):
        holding.wait_for(Mode.FAULT, 2)
    assert 2.0 <= (holding.clock.now_ns() - before_ns) / 1e9 < 2.1
