"""Every step of bring-up, for each profile and with homing, in `tests/traces/plans`.

`make golden` writes the files anew. A changed line is a drive that is configured in another way:
read the difference.
"""

import copy
from functools import partial
from pathlib import Path

import pytest
from drive_files import CYCLE, HIP_LIMITS, PROFILES, SLIDE_LIMITS, drive_of, join, table

from drives.bringup.plan import homing_plan, plan

FOLDER = Path(__file__).parents[1] / "traces" / "plans"
COUNTED = CYCLE._replace(sync_counter=10, sync_window_us=8000)


def homed_at_a_stop():
    """The hip's drive with every optional key of its axis file."""
    axis = copy.deepcopy(table("hip_epos4.toml"))
    axis["homing"] |= {"method": -4, "stop_current_a": 4.5}
    axis["identity"]["serial"] = 0x1234
    return homing_plan(join(axis, table(axis["profile"]), "hip_epos4"), HIP_LIMITS, CYCLE)


def brought_up(name):
    return plan(drive_of(name, "slide"), SLIDE_LIMITS, COUNTED)


PLANS = {**{name: partial(brought_up, name) for name in PROFILES}, "homing": homed_at_a_stop}


def whole(line, step):
    """A printed step, and the settings that are not printed."""
    width = f"{'i' if step.signed else 'u'}{step.bits}{'h' if step.is_hex else ''}"
    values = f"{step.value} {step.second} & {step.mask:08X}h"
    return f"{line:<120} {width:<5} {values} {step.failure.name.lower()}"


@pytest.mark.parametrize("name", PLANS)
def test_the_steps_of_bring_up_are_those_of_the_golden_plan(request, name):
    made = PLANS[name]()
    head, *lines = str(made).splitlines()
    text = "\n".join((head, *map(whole, lines, made.steps), ""))
    file = FOLDER / f"{name}.txt"
    if request.config.option.write_traces:
        file.write_text(text, encoding="utf-8")

    assert len(lines) == len(made.steps)
    assert text == file.read_text(encoding="utf-8")
