"""The eleven lines of Python of README, run as a reader runs them."""

import re
import signal
import subprocess
import sys

from documents import PROJECT
from tutorial import EXAMPLE

TORQUE = re.compile(r"([+-]\d+\.\d) ± \d+\.\d N·m")
WORKS_NM, MOST_NM = 3.0, 10.0
"""A passive patient is told with less than 1 N·m; the active one works with up to 8."""


def test_the_eleven_lines_print_the_patients_torque(tmp_path):
    ((name, text),) = EXAMPLE.findall((PROJECT / "README.md").read_text(encoding="utf-8"))
    lines = [line for line in text.splitlines() if line]
    assert (name, len(lines)) == ("torque", 11)

    (tmp_path / "torque.py").write_text(text, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, "-u", "torque.py"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    ) as program:
        torques_nm = []
        for line in program.stdout:
            assert line == "not known\n" or TORQUE.fullmatch(line.strip()), line
            torques_nm += [float(found) for found in TORQUE.findall(line)]
            if max(map(abs, torques_nm), default=0.0) > WORKS_NM:
                break
        program.send_signal(signal.SIGINT)

    assert WORKS_NM < max(map(abs, torques_nm)) < MOST_NM
