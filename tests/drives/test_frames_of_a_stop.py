"""The frames of a stop, in every order and with every loss: what stops a drive gives it no power.

A buffered 0Fh that a drive applies after a quick stop would leave quick stop active by transition
16. The search has a master that decides a stop in any part of a cycle, the product's RPDOs with a
controlword, and a drive of the standard (`third_model.py`). A frame on its way may be lost, or wait
for any time; frames of one identifier never overtake each other. The last test searches RPDOs that
the product does not have (docs/evidence/faster_stop.md): there transition 16 is found.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest
from drive_files import PROFILES, drive_of
from third_model import Model, statusword

from drives.cia402.pdo import CONTROLWORD, PdoLayout, layouts
from drives.cia402.power_state import Sent, decode_statusword, next_word
from drives.signals import PowerRequest, PowerState

CYCLES = 4
"""The stop is decided in the first two."""
LAST_DECISION = 2 * 2
LOSSES_MAX = 3
SYNC = 0x080
ENABLED = 0x0F
LAST_SYNCHRONOUS_TYPE = 240
PAGE = Path(__file__).parents[2] / "docs/evidence/faster_stop.md"


class State(NamedTuple):
    """Master, wire and drive between two events."""

    step: int = 0
    """What the master has sent: SYNC comes after an even number, commands after an odd one."""
    decided_step: int | None = None
    shown: PowerState = PowerState.OPERATION_ENABLED
    sent: Sent = Sent(ENABLED, was_enabled=True)
    wire: tuple[tuple[int, int], ...] = ()
    """Identifier and word of each frame that is on its way, in the order of sending."""
    buffered: int | None = ENABLED
    drive: str = "operation enabled"
    sync_count: int = 0
    """SYNCs that have arrived, or are lost."""
    losses: int = 0


class Found(NamedTuple):
    """What a search has found."""

    losses_to_power: int | None
    """Fewest losses with which a drive that has stopped gets power again; None: it never does."""
    syncs_to_stop: list[int]
    """The most SYNCs from the decision until the drive stops, for 0, 1, ... losses."""


class Search:
    """All that can happen to the frames of one drive."""

    def __init__(
        self,
        rpdos: Sequence[PdoLayout],
        with_a_stop: Sequence[PdoLayout] = (),
        *,
        request: PowerRequest = PowerRequest.QUICK_STOP,
        stays: bool = True,
        overtaking: bool = False,
    ) -> None:
        """Choose what is searched.

        Args:
            rpdos: those with a controlword, in the order of sending.
            with_a_stop: further ones, sent only from the decision on.
            request: the stop.
            stays: 605Ah is 5 to 8: the drive holds in quick stop active, and has transition 16.
            overtaking: frames of other identifiers may overtake each other, as a controller with
                several mailboxes sends them by priority.
        """
        self._always = tuple(one.can_id for one in rpdos)
        self._with_a_stop = tuple(one.can_id for one in with_a_stop)
        self._at_once = {
            one.can_id
            for one in (*rpdos, *with_a_stop)
            if one.transmission_type > LAST_SYNCHRONOUS_TYPE
        }
        self._request = request
        self._stays, self._overtaking = stays, overtaking

    def run(self) -> Found:
        """Explore every state."""
        begin = State(buffered=None if self._at_once.issuperset(self._always) else ENABLED)
        seen, waiting = {begin}, [begin]
        powered: list[int] = []
        slowest = [0] * (LOSSES_MAX + 1)
        while waiting:
            state = waiting.pop()
            for after in self._events(state):
                if after.decided_step is not None and after.drive != state.drive:
                    if after.drive == "operation enabled":
                        powered.append(after.losses)
                        continue
                    if state.drive == "operation enabled":
                        syncs = after.sync_count - (after.decided_step + 1) // 2
                        slowest[after.losses] = max(slowest[after.losses], syncs)
                if after not in seen:
                    seen.add(after)
                    waiting.append(after)
        return Found(min(powered, default=None), slowest)

    def _events(self, state: State) -> Iterator[State]:
        if state.step < 2 * CYCLES:
            yield self._master_goes_on(state)
        if state.decided_step is None and state.step < LAST_DECISION:
            decided = state._replace(decided_step=state.step)
            # Between SYNC and commands the window is open: the commands are the answer.
            yield decided if state.step % 2 else self._command(decided)
        passed: set[int] = set()
        for number, (can_id, word) in enumerate(state.wire):
            if can_id in passed:
                continue
            passed.add(can_id)
            rest = state._replace(
                wire=state.wire[:number] + state.wire[number + 1 :],
                sync_count=state.sync_count + (can_id == SYNC),
            )
            yield from self._arrives(rest, can_id, word)
            if state.losses < LOSSES_MAX:
                yield rest._replace(losses=state.losses + 1)
            if not self._overtaking:
                return

    def _master_goes_on(self, state: State) -> State:
        if state.step % 2:
            state = self._command(state)
        else:
            state = state._replace(wire=(*state.wire, (SYNC, 0)))
        return state._replace(step=state.step + 1)

    def _command(self, state: State) -> State:
        stopping = state.decided_step is not None
        request = self._request if stopping else PowerRequest.ENABLE
        sent = next_word(state.shown, request, state.sent, resume=True)
        can_ids = self._always + self._with_a_stop * stopping
        frames = [(can_id, sent.controlword) for can_id in can_ids]
        return state._replace(sent=sent, wire=(*state.wire, *frames))

    def _arrives(self, state: State, can_id: int, word: int) -> Iterator[State]:
        if can_id == SYNC:
            applied = state._replace(buffered=None)
            if state.buffered is not None:
                applied = self._applied(applied, state.buffered)
            yield applied
            window_open = state.step % 2 == 1 and SYNC not in dict(state.wire)
            if window_open:  # TPDO1, sampled before the RPDOs are applied, has arrived
                yield applied._replace(shown=decode_statusword(statusword(state.drive, 0)))
        elif can_id in self._at_once:
            yield self._applied(state, word)
        else:
            yield state._replace(buffered=word)

    def _applied(self, state: State, word: int) -> State:
        model = Model(state.drive, automatic_4=True, stays=self._stays)
        model.take(word)
        return state._replace(drive=model.state)


def with_controlword(profile: str) -> list[PdoLayout]:
    """The product's RPDOs that have a controlword."""
    pdos = layouts(drive_of(profile).profile, node_id=5)
    return [one for one in pdos if not one.transmit and CONTROLWORD in one.objects]


@pytest.mark.parametrize("overtaking", [False, True])
@pytest.mark.parametrize("word", [PowerRequest.QUICK_STOP, PowerRequest.DISABLE_VOLTAGE])
@pytest.mark.parametrize("profile", PROFILES)
def test_no_order_and_no_loss_gives_power_to_a_drive_that_has_stopped(profile, word, overtaking):
    found = Search(with_controlword(profile), request=word, overtaking=overtaking).run()

    assert found.losses_to_power is None
    if not overtaking:  # the next SYNC stops it, and each lost frame costs one SYNC
        assert found.syncs_to_stop == [1, 2, 3, 4]


def test_the_page_about_a_faster_stop_has_what_the_search_finds():
    rpdo1 = with_controlword("epos4")
    rpdo3 = [replace(one, number=3, can_id=0x405, transmission_type=255) for one in rpdo1]
    at_once = [replace(one, transmission_type=255) for one in rpdo1]
    rows = (
        ("RPDO1, synchronous: as it is", "5 to 8", rpdo1, (), True),
        ("RPDO1, and with a stop RPDO3, event-driven", "5 to 8", rpdo1, rpdo3, True),
        ("RPDO1, and with a stop RPDO3, event-driven", "0 to 4", rpdo1, rpdo3, False),
        ("RPDO1, event-driven", "5 to 8", at_once, (), True),
    )
    page = PAGE.read_text(encoding="utf-8")

    for name, option, always, with_a_stop, stays in rows:
        in_order, any_order = (
            Search(always, with_a_stop, stays=stays, overtaking=overtaking).run()
            for overtaking in (False, True)
        )
        syncs = ", ".join(map(str, in_order.syncs_to_stop))
        row = f"| {name} | {option} | {syncs} | {_power(in_order)} | {_power(any_order)} |"
        assert row in page


def _power(found: Found) -> str:
    return "never" if found.losses_to_power is None else f"with {found.losses_to_power} lost"
