"""The eleven lines of Python of README, as a reader runs them, until the patient works."""

import re

import pytest
from documents import PROJECT
from tutorial import EXAMPLE

TORQUE = re.compile(r"([+-]\d+\.\d) ± \d+\.\d N·m")
WORKS_NM, MOST_NM = 3.0, 10.0
"""A passive patient is told with less than 1 N·m; the active one works with up to 8."""


class SeenError(Exception):
    """The reader has seen enough."""


def test_the_eleven_lines_print_the_patients_torque():
    ((name, text),) = EXAMPLE.findall((PROJECT / "README.md").read_text(encoding="utf-8"))
    lines = [line for line in text.splitlines() if line]
    assert (name, len(lines)) == ("torque", 11)
    torques_nm = []

    def read(line):
        assert line == "not known" or TORQUE.fullmatch(line), line
        torques_nm.extend(float(found) for found in TORQUE.findall(line))
        if max(map(abs, torques_nm), default=0.0) > WORKS_NM:
            raise SeenError

    with pytest.raises(SeenError):
        exec(compile(text, "torque.py", "exec"), {"print": read})

    assert max(map(abs, torques_nm)) < MOST_NM
