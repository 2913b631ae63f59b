"""Every state of the core's steps, one event and two events at once: the invariants hold."""

from collections.abc import Callable
from typing import Any

import pytest
from gaitd_names import Cause, Mode

from daemon.core.steps import impedance, supervisor
from drives.signals import PowerRequest
from tests.daemon.core.steps.exploration import SHORT, VERDICTS, BrokenError, Search


@pytest.fixture(autouse=True)
def short_times(monkeypatch):
    for (module, name), cycles in SHORT.items():
        monkeypatch.setattr(module, name, cycles)


def explored(per_class: int, **pairs: Any) -> None:
    search = Search()
    search.run(per_class, **pairs)
    search.check_ends()
    found = f"{len(search.states)} states, {search.transition_count} transitions"
    print(f"{found}, {len(search.classes)} classes of states")
    assert {state.mode for state in search.states.values()} == set(Mode)


def test_no_event_and_no_two_at_once_break_an_invariant_in_any_class_of_states():
    """A sixth of the pairs in each class, and other ones in the next: all pairs come many times."""
    explored(2, pairs_per_class=1, pairs_every=6)


@pytest.mark.thorough
@pytest.mark.timeout(7200)
def test_no_two_events_at_once_break_an_invariant_in_sixty_states_of_each_class():
    explored(60, pairs_per_class=10, left_out=frozenset())


# --- the search can fail --------------------------------------------------------------------------


def _enabled_in_a_stop(core, axis):
    return PowerRequest.ENABLE if core.mode == Mode.STOPPING else POWER(core, axis)


def _kept_apart(core, verdict, axis):
    return FIRST_STEP(core, verdict, axis) if verdict.drive in {"", axis.name} else 0


FIRST_STEP = supervisor._first_step
POWER = impedance._power
MUTATIONS: dict[str, tuple[object, str, Callable[..., object], str]] = {
    "the newest verdict is latched": (supervisor, "_replaces", lambda *_: True, "becomes"),
    "a stop does not take power away": (impedance, "_power", _enabled_in_a_stop, "told to enable"),
    "the other axis only holds": (supervisor, "_first_step", _kept_apart, "not stopped by it"),
}


@pytest.mark.parametrize("mutation", MUTATIONS)
def test_a_planted_fault_is_found_with_the_way_to_it(mutation, monkeypatch):
    module, name, planted, said = MUTATIONS[mutation]
    monkeypatch.setattr(module, name, planted)

    with pytest.raises(BrokenError, match=said) as broken:
        Search().run(2, pairs_per_class=1, pairs_every=6)

    assert "\n  off: nothing" in str(broken.value)


def test_a_stop_that_never_ends_is_found(monkeypatch):
    monkeypatch.setattr(supervisor, "_stopped", lambda *_: False)
    search = Search()

    with pytest.raises(BrokenError, match="no end after a stop"):
        search.run(1)
        search.check_ends()


def test_a_verdict_of_every_category_is_among_the_events():
    causes = {event.what for event in VERDICTS}
    categories = {Search().model.core.config.categories.of(cause).name for cause in causes}

    assert categories == {"S0", "S1", "S2"}
    assert Cause.SHUTDOWN in causes
