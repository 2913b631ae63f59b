"""What the preparation of a machine tells the operator, and reads in the service's events.

For `gaitd self-test`, `commission` and `reference` (`preparation.py`), and for the acceptance
(`acceptance.py`).
"""

from typing import Final

MOTIONS: Final = {
    "hip": "the thigh is first raised towards the trunk (the hip bends), then lowered again",
    "slide": "the slide first moves so that the knee stretches, then comes back",
}
"""Motion of each joint in its positive direction and back, in the axes of robot.toml."""
HOMING_MAX_S: Final = 360.0
"""Longer than any homing may take."""
STEP_MAX_S: Final = 120.0
"""Time for each step of the self-test that the operator does."""
PASSED: Final = "self-test passed"
MOVES: Final = "moves with its torque"
RESULT: Final = ": self-test "
UNTESTED: Final = "not seen to act today: "

PRESS: Final = "Press the emergency stop, and release it again."
PROMPTS: Final = (
    ("pressed", PRESS),
    ("released", "Release the emergency stop."),
    ("switch open", "Let go of the hand switch, then hold it again."),
    ("switch closed", "Hold the hand switch."),
    ("hand switch is open", "Hold the hand switch."),
    ("safe torque off", "Release the emergency stop."),
    ("moving", "Keep the leg still."),
)
"""Prompt for the operator, by a part of the reason with which the service refuses to enable."""


def prompt(reason: str) -> str:
    """Prompt for the operator after a refusal; the service's reason if no prompt matches."""
    missing = reason.removeprefix(UNTESTED).split(", ") if reason.startswith(UNTESTED) else [reason]
    for key, text in PROMPTS:
        if any(key in one for one in missing):
            return text
    return f"waiting: {reason}"
