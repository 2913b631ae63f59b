"""What the preparation of a machine tells the operator.

For `gaitd self-test`, `commission` and `reference` (`preparation.py`), and for the acceptance
(`acceptance.py`).
"""

from typing import Final

from gaitd_client import wire

from daemon.ipc.report import RefusalCode, Untested
from daemon.wire.names import name_of

MOTIONS: Final = {
    "hip": "the thigh is first raised towards the trunk (the hip bends), then lowered again",
    "slide": "the slide first moves so that the knee stretches, then comes back",
}
"""Motion of each joint in its positive direction and back, in the axes of robot.toml."""
HOMING_MAX_S: Final = 360.0
"""Longer than any homing may take."""
STEP_MAX_S: Final = 120.0
"""Time for each step of the self-test that the operator does."""
MOVES: Final = "moves with its torque"

PRESS: Final = "Press the emergency stop, and release it again."
HOLD_SWITCH: Final = "Hold the hand switch."
RELEASE: Final = "Release the emergency stop."
PROMPTS: Final = {
    name_of(RefusalCode.HAND_SWITCH_OPEN): HOLD_SWITCH,
    name_of(RefusalCode.STO_ACTIVE): RELEASE,
    name_of(RefusalCode.LEG_MOVES): "Keep the leg still.",
}
"""Prompt for the operator, by the code of the refusal to enable."""
UNTESTED: Final = {
    name_of(Untested.HAND_SWITCH_OPEN): "Let go of the hand switch, then hold it again.",
    name_of(Untested.HAND_SWITCH_CLOSED): HOLD_SWITCH,
    name_of(Untested.STO_ACTIVE): PRESS,
    name_of(Untested.STO_RELEASED): RELEASE,
}
"""Prompt for the operator, by the state of an input that the service has still to see."""


def prompt(reason: str, refusal: wire.Refusal | None) -> str:
    """Prompt for the operator after a refusal; the service's reason if there is none."""
    text = None
    if refusal is not None:
        state = refusal.values.get("untested")
        text = PROMPTS.get(refusal.code) if state is None else UNTESTED.get(str(state))
    return text or f"waiting: {reason}"
