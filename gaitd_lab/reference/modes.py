"""The modes of the service as a diagram and tables, from the core's own tables.

No fact is repeated in this file: rows, requests, refusals, categories and texts are read from
`daemon/core/modes/table.py`, `daemon/wire/causes.py` and a limits file. The refusals are found by
calling the guard with inputs in which one thing is wrong.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

from gaitd_names import Cause, Doubt, Mode, RequestKind, SelfTestDue, Trigger, Untested
from gaitd_texts import COMMANDS, Reader, catalogue, stop_of
from gaitd_texts.stops import Again, GoOn, Situation, key_of

from analysis import markdown
from daemon.core.exercises.guards import GuardInputs
from daemon.core.modes.table import TRANSITIONS, refusal, trigger_of
from daemon.core.safety.limits import Categories
from daemon.ipc.record import ModeRequest
from daemon.report_messages import refusal_message
from daemon.wire.causes import DOUBTFUL_FEEDBACK, FIXED_CATEGORY, LOST_DRIVE

TEXTS: Final = catalogue(Reader.OPERATOR, "en")

WELL: Final = GuardInputs(
    mode=Mode.READY,
    gateway_alive=True,
    at_rest=True,
    hand_switch_closed=True,
    hand_switch_known=True,
    sto_released=True,
    unreferenced=(),
    outside=(),
    drives_powered=True,
    cadence_max_hz=0.5,
    scenarios={"paper": 25.0},
    artificial=frozenset({"paper"}),
    patient_configured=False,
    guidance="impedance",
)
"""Guard inputs in which nothing is wrong. Values that a configuration chooses are examples."""

REQUESTS: Final[Mapping[str, tuple[RequestKind, ModeRequest]]] = {
    "enable": (RequestKind.ENABLE, ModeRequest()),
    "disable": (RequestKind.DISABLE, ModeRequest()),
    "reset": (RequestKind.RESET, ModeRequest()),
    "mode hold": (RequestKind.MODE, ModeRequest(Mode.HOLD)),
    "mode gait": (RequestKind.MODE, ModeRequest(Mode.GAIT, 0.25, 1.0, 60.0)),
    "mode torque": (RequestKind.MODE, ModeRequest(Mode.TORQUE)),
    "mode excite": (RequestKind.MODE, ModeRequest(Mode.EXCITE, duration_s=25.0, scenario="paper")),
    "mode hand_guiding": (RequestKind.MODE, ModeRequest(Mode.HAND_GUIDING)),
    "mode self_test": (RequestKind.MODE, ModeRequest(Mode.SELF_TEST)),
    "mode reference": (RequestKind.MODE, ModeRequest(Mode.REFERENCE, axis="right/hip")),
    "mode commission": (RequestKind.MODE, ModeRequest(Mode.COMMISSION, axis="right/hip")),
}
"""Each request that a client may send, with permitted arguments. `stop` needs none."""

WRONG: Final[Mapping[str, Mapping[str, Any]]] = {
    "the gateway is silent": {"gateway_alive": False},
    "a joint moves": {"at_rest": False},
    "a joint was not sampled in this cycle": {"unsampled": ("right/hip",)},
    "the hand switch is open": {"hand_switch_closed": False},
    "STO is active": {"sto_released": False},
    "an axis is not referenced": {"unreferenced": (("right/hip", Doubt.NOT_HOMED),)},
    "an axis is outside its range": {"outside": ("right/slide",)},
    "a sign is not proven": {"unproven": ("right/hip",)},
    "an input was not seen to act today": {
        "inputs_untested": (("right/hip", Untested.HAND_SWITCH_OPEN),)
    },
    "no self-test was passed today": {"self_test_due": SelfTestDue.NOT_PASSED_TODAY},
    "the drives do not hold yet": {"drives_powered": False},
    "a patient is configured": {"patient_configured": True},
    "guidance is by position": {"guidance": "position"},
}


def parts(chosen: Mapping[str, str]) -> dict[str, str]:
    """Return the generated parts of docs/modes.md by name.

    Args:
        chosen: `stop_category` of the limits file that is shown.
    """
    refused = ("request", "in mode", "while", "is refused with")
    causes = ("cause", "category", "text", "the leg", "step", "go on", "if it comes back")
    return {
        "diagram": "\n".join(("```mermaid", *diagram(), "```")),
        "requests": markdown.table(("request", *map(_word, Mode)), _possible()),
        "refusals": markdown.table(refused, _refusals()),
        "stops": markdown.table(causes, _stops(chosen)),
        "first": markdown.table(("the leg", "do this first"), _named("first", Situation)),
        "go_on": markdown.table(
            ("go on", "after the step of the cause"),
            ((name, TEXTS.text(f"go_on.{name}", **COMMANDS)) for name in GoOn if name != GoOn.ONLY),
        ),
        "again": markdown.table(("if it comes back", "do this"), _named("again", Again)),
    }


def diagram() -> Iterator[str]:
    """State diagram in Mermaid; transitions that all enabled modes share start at one box."""
    yield "stateDiagram-v2"
    yield "    direction LR"  # at the width of a page the labels stay readable
    yield "    [*] --> off"
    shared = _shared()
    yield from _edges("    ", lambda mode, _event, _to: not mode.active)
    yield "    state enabled {"
    yield "        direction LR"
    yield from _edges("        ", lambda mode, _event, to: mode.active and to.active)
    for mode in (Mode.REFERENCE, Mode.COMMISSION):
        yield f"        {_word(mode)}"
    yield "    }"
    for to in dict.fromkeys(shared.values()):
        words = ", ".join(trigger_text(event) for event, target in shared.items() if target == to)
        yield f"    enabled --> {_word(to)}: {words}"
    yield from _edges(
        "    ", lambda mode, event, to: mode.active and not to.active and event not in shared
    )


def _shared() -> dict[Trigger, Mode]:
    """Events with the same target mode in every enabled mode, and that target."""
    active = [mode for mode in Mode if mode.active]
    return {
        event: TRANSITIONS[active[0], event]
        for event in Trigger
        if len({TRANSITIONS.get((mode, event)) for mode in active}) == 1
        and (active[0], event) in TRANSITIONS
    }


def _edges(indent: str, wanted: Callable[[Mode, Trigger, Mode], bool]) -> Iterator[str]:
    """One arrow for each pair of modes, with all of its wanted events."""
    words: dict[tuple[Mode, Mode], list[str]] = {}
    for (mode, event), to in TRANSITIONS.items():
        if wanted(mode, event, to):
            words.setdefault((mode, to), []).append(trigger_text(event))
    for (mode, to), events in words.items():
        yield f"{indent}{_word(mode)} --> {_word(to)}: {', '.join(events)}"


def _possible() -> Iterator[tuple[str, ...]]:
    for name, (kind, wanted) in REQUESTS.items():
        event = trigger_of(kind, wanted)
        yield name, *("yes" if (mode, event) in TRANSITIONS else "–" for mode in Mode)
    yield "stop", *("stops" if _moves(mode) else "yes" for mode in Mode)


def _moves(mode: Mode) -> bool:
    return mode.active or mode in {Mode.STOPPING, Mode.FAULT}


def _refusals() -> Iterator[tuple[str, ...]]:
    """Refusals by the guard: with nothing wrong, and those that one wrong thing adds or changes."""
    for name, (kind, wanted) in REQUESTS.items():
        event = trigger_of(kind, wanted)
        for mode in (mode for mode in Mode if (mode, event) in TRANSITIONS):
            usual = refusal(kind, wanted, replace(WELL, mode=mode))
            if usual:
                yield name, _word(mode), "all is well", TEXTS.refusal(refusal_message(usual))
            for words, change in WRONG.items():
                reason = refusal(kind, wanted, replace(WELL, mode=mode, **change))
                if reason and reason != usual:
                    yield name, _word(mode), words, TEXTS.refusal(refusal_message(reason))


def _stops(chosen: Mapping[str, str]) -> Iterator[tuple[str, ...]]:
    categories = Categories(chosen)
    for cause in Cause:
        if cause == Cause.NONE:
            continue
        name = cause
        stop = stop_of(name)
        category = categories.of(cause).name
        if cause in FIXED_CATEGORY:
            category += " (fixed)"
        if cause in DOUBTFUL_FEEDBACK:
            category += "; S1 for other axes"
        if cause in LOST_DRIVE:
            category += "; NMT stop to the lost drive"
        yield (
            name,
            category,
            TEXTS.text(f"stopped.{name}"),
            _words(stop.situation),
            _step(name),
            "–" if stop.go_on is GoOn.ONLY else stop.go_on,
            _words(stop.again),
        )


def _step(cause: Cause) -> str:
    """What belongs to this cause alone; what many causes share is in tables of its own."""
    key = f"stop_step.{stop_of(cause).step_of or key_of(cause)}"
    text = TEXTS.text(key, **COMMANDS) if TEXTS.has(key) else "–"
    return text[:1].upper() + text[1:]


def _named(group: str, members: Iterable[str]) -> Iterator[tuple[str, str]]:
    for name in members:
        text = TEXTS.text(f"{group}.{name}")
        yield _words(name), text[:1].upper() + text[1:]


def _words(name: str) -> str:
    return name.replace("_", " ")


def _word(mode: Mode) -> str:
    return mode


def trigger_text(trigger: Trigger) -> str:
    """The trigger of a transition, as the page names it."""
    return TEXTS.text(f"trigger.{trigger}")
