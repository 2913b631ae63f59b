"""Inputs of the steps of a cycle: axis, leg and core with what the tested step reads of them."""

from types import SimpleNamespace
from typing import Any

from gaitd_names import EventCode, Mode
from msgspec.structs import replace
from safety_inputs import FEEDBACK, JOINT, LIMITS

from daemon.core.slices import LegAssist, Monitored, Passive, Placed, Sensed, Sent, Softened
from daemon.ipc.report import Event

AT_REST = JOINT._replace(velocity_si=0.0, still_cycles=100)
SHOWN = Sensed(
    feedback=FEEDBACK,
    joint=AT_REST,
    referenced=True,
    followed=True,
    watched=True,
    reached_enabled=True,
    gravity_si=7.0,
)
"""An enabled drive at rest, whose position is known."""


def an_axis(name: str = "right/hip", **changes: Any) -> SimpleNamespace:
    """An axis; what is no field of `Sensed` or `Sent` becomes one of its own.

    `mode` and `position_si` are those sent, where both have one.
    """
    shown = {one: changes.pop(one) for one in Sensed.__struct_fields__ if one in changes}
    sent = {one: changes.pop(one) for one in Sent.__struct_fields__ if one in changes}
    own = {"limits": LIMITS, "stop": None, "serial_number": 11, "sign_proven": False}
    return SimpleNamespace(
        name=name,
        sensed=replace(SHOWN, **shown),
        sent=replace(Sent(), **sent),
        **{**own, **changes},
    )


def now_shows(axis: SimpleNamespace, **changes: Any) -> None:
    """Make an axis show something else than before: fields of its `Sensed`."""
    axis.sensed = replace(axis.sensed, **changes)


def was_sent(axis: SimpleNamespace, **changes: Any) -> None:
    """Make the last command to an axis another one: fields of its `Sent`."""
    axis.sent = replace(axis.sent, **changes)


def a_leg(*axes: SimpleNamespace, **changes: Any) -> SimpleNamespace:
    """A leg of these axes, without any exercise."""
    own = {
        "axes": axes or (an_axis(), an_axis("right/slide")),
        "name": "right",
        "exercise": None,
        "reference": None,
        "takes_over": False,
        "passive": Passive(),
        "placed": Placed(),
        "monitored": Monitored(),
        "assist": LegAssist(),
        "softened": Softened(),
        "guidance_ratio": 1.0,
        "is_held": False,
        "is_located": True,
    }
    return SimpleNamespace(**{**own, **changes})


def a_core(*legs: SimpleNamespace, **changes: Any) -> SimpleNamespace:
    """A core of these legs in mode HOLD that keeps the events which are reported."""
    legs = legs or (a_leg(),)
    events = list[Event]()

    def report(code: EventCode, subject: str = "", *values: float | str, said: str = "") -> None:
        events.append(Event(code, subject, values, said))

    own = {
        "report": report,
        "legs": legs,
        "axes": tuple(axis for leg in legs for axis in leg.axes),
        "mode": Mode.HOLD,
        "load_checked": True,
        "single_axis": None,
        "bring_up": None,
        "reset_cycles_left": 0,
        "events": events,
    }
    return SimpleNamespace(**{**own, **changes})
