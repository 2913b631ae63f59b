"""An act is played again when this machine was too slow for it, and for no other reason."""

import time

import pytest
from msgspec.structs import replace
from records import HEADER, record

from daemon.seam import RING_NAME, RingWriter
from gaitd.demonstration.performance import REPEATS_MAX, Performance
from gaitd.demonstration.script import ActError, Kind, Scene, plan_of
from gaitd.demonstration.stage import Stage, of_late
from gaitd.remote import Target


class Screen:
    def __init__(self):
        self.said: list[str] = []

    def show(self, moment):
        pass

    def scene(self, scene):
        pass

    def say(self, words):
        self.said.append(words)


@pytest.fixture
def played(monkeypatch):
    """Plays acts that fail so many times, on a computer that held them up or did not."""

    def play(failures: int, *held_up: str):
        made = Performance(None, plan_of(30.0), Screen())
        left = [failures]

        def act(_act, *, empty):
            made._begin_scene(Scene("gait", Kind.ACTIVE, 1.0))
            if left[0]:
                left[0] -= 1
                time.sleep(0.1)
                error = ActError("the service stopped: a drive does not answer")
                error.held_up = held_up
                raise error

        monkeypatch.setattr(made, "_act", act)
        return made.play()

    return play


def test_an_act_that_the_machine_held_up_is_played_again_and_only_then_judged(played):
    results = played(1, "SYNC 112.0 ms late")

    assert not results.trouble
    assert len(results.repeats) == 1
    assert "112.0 ms" in results.repeats[0]
    assert "does not answer" in results.repeats[0]
    assert [span.kind for span in results.spans].count(Kind.ACTIVE) == 1
    assert min(span.begin_ns for span in results.spans) >= results.spans[-1].begin_ns - 10**7


def test_a_service_that_stops_for_reasons_of_its_own_gets_no_second_chance(played):
    results = played(1)

    assert "does not answer" in results.trouble
    assert not results.repeats
    assert not results.passed


def test_a_machine_that_is_too_slow_every_time_is_given_up(played):
    results = played(10, "SYNC 112.0 ms late", "11 grid points missed")

    assert "stood still: SYNC 112.0 ms late, 11 grid points missed" in results.trouble
    assert len(results.repeats) == REPEATS_MAX


def test_ctrl_c_ends_the_performance_in_an_orderly_way(monkeypatch):
    made = Performance(None, plan_of(30.0), Screen())

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(made, "_act", interrupted)

    assert made.play().trouble == "interrupted"


def test_what_held_the_act_up_is_read_from_the_records_of_the_core(tmp_path):
    assert of_late(tmp_path / RING_NAME) == ()

    writer = RingWriter(tmp_path / RING_NAME, HEADER)
    assert of_late(tmp_path / RING_NAME) == ()
    for seq in range(1, 6):
        writer.write(record(seq))
    assert of_late(tmp_path / RING_NAME) == ()
    writer.write(replace(record(6), timing=replace(record(6).timing, lateness_ns=396_000_000)))
    writer.close()

    assert of_late(tmp_path / RING_NAME) == ("SYNC 396.0 ms late",)


class Troupe:
    def __init__(self, code: int | None):
        self.exit_code = lambda: code


@pytest.mark.parametrize(
    ("drives", "service", "wanted"),
    [(None, None, ("SYNC 396.0 ms late",)), (-9, None, ()), (None, 1, ())],
)
def test_an_act_that_a_dead_process_ended_is_not_excused(tmp_path, drives, service, wanted):
    (tmp_path / "run").mkdir()
    writer = RingWriter(tmp_path / "run" / RING_NAME, HEADER)
    writer.write(replace(record(1), timing=replace(record(1).timing, lateness_ns=396_000_000)))
    writer.close()
    places = tmp_path, tmp_path, tmp_path, tmp_path
    where = Stage(*places, Target((), "trainer"), "right", Troupe(drives), Troupe(service))

    with pytest.raises(ActError) as caught, where.excused():
        raise ActError("the service stopped: a drive does not answer")

    assert caught.value.held_up == wanted
