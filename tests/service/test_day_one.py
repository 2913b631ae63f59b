"""The first day of a trainer: the commands of docs/day_one.md, played as its maker types them.

The page is the script. Each block of console commands is run in its order, on virtual drives that
were never homed, with three mistakes of the maker; outputs and exit codes must be those of the
page. `--write-pages` writes them anew.
"""

import contextlib
import io
import math
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Final, NamedTuple
from unittest.mock import patch

import pytest
from documents import BLOCK, PROJECT
from gaitd_client import Trainer
from gaitd_client import trainer as client_library
from gaitd_session import Advice, program, terminal
from gaitd_session.plan import BlockKind

from daemon.config.edits import edit
from gaitd.__main__ import main as main_of_gaitd
from gaitd.commissioning import remote_service
from gaitd_lab.processes import memory_folder
from gaitd_lab.testing.trainer import VirtualTrainer

PAGE: Final = PROJECT / "docs" / "day_one.md"
MISTAKES: Final = {
    "drives/hip_epos4.toml": ("sign = 1", "sign = -1"),
    "drives/slide_epos4.toml": ("node_id = 6", "node_id = 7"),
    "robot_empty.toml": ("hip.rest_rad", "hip.rest_deg"),
}
"""What the maker has written, and it is not so."""
HANDS: Final = {
    "Let go of the hand switch": "hand_switch_open * 1.0",
    "Press the emergency stop": "sto_open * 1.0",
}
"""What the operator's hands do, when a command asks for it."""
SESSION_PACE: Final = "max"
"""Speed of simulated time in the session, whose program runs at the computer's."""
ANSWERS_S: Final = 60.0
"""A busy computer changes nothing that the page shows: time is simulated."""
START_S: Final = 60.0
"""Longest start of a service whose kernels are compiled."""
HANDS_S: Final = 1.5
"""Time for it; the switch is then as before."""
MEASURED: Final = (
    (
        r"(?m)^  (right, \w+: [a-z ]+|setting up the drives: .*)\n",
        "",
    ),  # progress, as often as it was asked
    (r"(?m)^\d\d:\d\d:\d\d .*\n", ""),  # the newest events
    (r"A drive has (a fault|reported an error)", "FAULT"),  # statusword and EMCY race
    (r"(?m)^not valid: no message on .*\n", ""),  # a busy computer, by whose clock `wait` listens
    (r"\b\d{4}-\d\d-\d\d \d\d:\d\d\b", "DATE"),
    (r"\b\d+:\d\d\b( +\d+\b(?!%))*", "0:00"),  # with the strides behind it, in a summary
    (r"(?<=N|m), (–|\d+ °C)", ", 0 °C"),  # the drives' temperatures are read in turns
    (r"[-+]?(\d+\.\d+(e[-+]\d+)?|\b\d+(?= N| rad| m\b))", "0.0"),
    (r"\b\d+( ?%| °C| of \d+ steps)", r"0\1"),
    (r"\d+ steps", "0 steps"),
    (r"\b[0-9a-z]{8}\.toml", "ID.toml"),
    (r" +", " "),
)
"""What differs from run to run, and what stands for it when outputs are compared."""


class Step(NamedTuple):
    """A line that is typed, and what the page shows of it."""

    typed: str
    shown: str


def steps(block: str) -> Iterator[Step]:
    """Every command, and every act at the machine, of a block."""
    for one in re.split(r"^(?=[$#] )", block, flags=re.MULTILINE):
        if one:
            typed, _, shown = one.partition("\n")
            yield Step(typed, shown)


def comparable(text: str) -> str:
    """The text without what differs from run to run."""
    for pattern, stands in MEASURED:
        text = re.sub(pattern, stands, text)
    return text


class Output(io.StringIO):
    """Both streams in their order; the operator's hands follow what is written."""

    def __init__(self, trainer: VirtualTrainer) -> None:
        super().__init__()
        self._trainer = trainer

    def write(self, text: str) -> int:
        count = super().write(text)
        for said, line in HANDS.items():
            if said.lower() in text.lower():
                self._trainer.tell(line)
                self._trainer.run(HANDS_S)
        return count


class Keyboard(io.StringIO):
    """The answers to questions of a command, which a terminal shows as they are typed."""

    def __init__(self, answers: list[str], output: Output) -> None:
        super().__init__("".join(f"{one}\n" for one in answers))
        self._output = output

    def readline(self, size: int = -1) -> str:
        line = super().readline(size)
        self._output.write(line)
        return line


class Maker:
    """Types commands at the machine, and does what they ask for."""

    def __init__(self, folder: Path) -> None:
        package = folder / "package"
        subprocess.run(
            ["bash", "scripts/install.sh", "files"],
            cwd=PROJECT,
            env={**os.environ, "DESTDIR": str(package)},
            check=True,
            capture_output=True,
        )
        etc = package / "etc/gaitd"
        for name, (right, wrong) in MISTAKES.items():
            file = etc / name
            text = file.read_text(encoding="utf-8")
            assert right in text
            file.write_text(text.replace(right, wrong, 1), encoding="utf-8")
        self.trainer = VirtualTrainer(folder, etc, trainer_file="trainer.toml")
        self.etc = self.trainer.config.parent
        self.places = {
            "/etc/gaitd": str(self.etc),
            "/run/bus": str(self.trainer.channel),
            "/var/lib/gaitd": str(folder / "state"),
        }
        self.home = folder / "home"
        self.home.mkdir()
        self.answers: list[str] = []
        machine = shutil.copytree(PROJECT / "configs", folder / "machine")
        edit(machine, {"demo.toml": {"bus.channel": str(self.trainer.channel)}})
        self._switched_on("robot_empty.toml")
        clock = self.trainer.clock
        self.time = SimpleNamespace(sleep=self.trainer.run, monotonic=lambda: clock.now_ns() * 1e-9)
        """Simulated, for commands that ask the service again and again."""

    # --- the machine ----------------------------------------------------------------------------

    def _switched_on(self, robot: str) -> None:
        """Give the drives power; the leg is where it was left, the springs are of this file."""
        machine = self.trainer.folder / "machine"
        edits = {"robot": robot, "friction.law": "paper_sticking"}
        if self.trainer.runs("sim"):
            self.trainer.parts["sim"].end()
            left = self.trainer.truth()[-1]
            edits["start.hip.position_deg"] = math.degrees(float(left["hip_angle_rad"]))
            edits["start.slide.position_m"] = float(left["slide_position_m"])
        edit(machine, {"plant.toml": edits})
        real, self.trainer.config = self.trainer.config, machine / "demo.toml"
        self.trainer.start_drives()
        self.trainer.config = real

    # --- commands -------------------------------------------------------------------------------

    def types(self, step: Step) -> str:
        """What a command shows, and its exit code if that is not 0."""
        self.answers = re.findall(r"\[y/N\]: (\w)", step.shown)
        words = step.typed.removeprefix("$ ")
        for name, place in self.places.items():
            words = words.replace(name, place)
        for file in self.home.glob("*.toml"):
            words = words.replace("*.toml", file.name)
        code, out = self._ran(words)
        for name, place in self.places.items():
            out = out.replace(place, name)
        out = re.sub(r"[ \t]+\n", "\n", out).replace("╯W", "╯\nW")
        lines = out.splitlines()
        if code:
            lines.append(f"[exit code {code}]")
        return "".join(line + "\n" for line in lines)

    def _ran(self, line: str) -> tuple[int, str]:
        match line.split():
            case ["#", *_]:
                self._switched_on("robot.toml")
                return 0, ""
            case ["apt-get", *_]:
                return 0, ""
            case ["systemctl", action, *_]:
                self._service(action)
                return 0, ""
            case ["gaitd", "wait", *words]:
                with self._fast("max"):
                    return self._in_process(main_of_gaitd, "gaitd", ["wait", *words])
            case ["gaitd", *words]:
                return self._in_process(main_of_gaitd, "gaitd", words)
            case ["install", *_]:
                return self._shell(re.sub(r"-[og] \S+ ", "", line))  # the users are in no clone
            case ["gaitd-session", "run", *words]:
                return self._session(words)
            case ["gaitd-session", *words]:
                return self._in_process(program.main, "gaitd-session", words)
            case _:
                return self._shell(line)

    def _shell(self, line: str) -> tuple[int, str]:
        done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
        return done.returncode, done.stdout + done.stderr

    @contextlib.contextmanager
    def _fast(self, pace: str) -> Iterator[None]:
        self.trainer.tell(f"pace {pace}")
        yield
        self.trainer.tell("pace 1")

    def _service(self, action: str) -> None:
        if action in {"stop", "restart"}:
            for part in ("core", "gateway"):
                self.trainer.parts[part].end()
        if action in {"start", "restart"}:
            before = self.trainer.boot_id()
            for part in ("core", "gateway"):
                self.trainer.start(part)
            self.trainer.wait(lambda: self.trainer.boot_id() not in {before, ""}, START_S)
            self.trainer.wait(self._listens, START_S)

    def _listens(self) -> bool:
        """Whether the gateway has told systemd that it is ready, which is when it listens."""
        with socket.socket() as client:
            return client.connect_ex(("127.0.0.1", self.trainer.zenoh_port)) == 0

    def _in_process(self, main, name: str, words) -> tuple[int, str]:
        output, code = Output(self.trainer), 0
        keyboard = Keyboard(self.answers, output) if name == "gaitd" else sys.stdin
        with (
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(output),
            contextlib.chdir(self.home),
            patch.object(sys, "argv", [name, *words]),
            patch.object(sys, "stdin", keyboard),
            patch.object(remote_service, "time", self.time),
            patch.object(client_library, "ANSWER_TIMEOUT_S", ANSWERS_S),
        ):
            try:
                main()
            except SystemExit as end:
                code = end.code if isinstance(end.code, int) else 0
        return code, output.getvalue()

    def _session(self, words) -> tuple[int, str]:
        """The patient presses START where the terminal asks for it, and walks along."""
        keyboard, stdin = os.openpty()
        drawn = terminal.render

        def render(view, texts):
            if view.advice in {Advice.PRESS_START, Advice.PRESS_START_TO_RESET}:
                relaxes = view.block is None or view.block.kind is BlockKind.PASSIVE
                self.trainer.patient("passive" if relaxes else "active")
                os.write(keyboard, b"s")
            return drawn(view, texts)

        with (
            os.fdopen(stdin, encoding="utf-8") as typed,
            patch.object(sys, "stdin", typed),
            patch.object(terminal, "render", render),
            patch.object(program, "Trainer", partial(Trainer, clock=self.trainer.clock)),
            patch.object(program, "MonotonicClock", lambda: self.trainer.clock),
            self._fast(SESSION_PACE),
        ):
            ended = self._in_process(program.main, "gaitd-session", ["run", *words])
        os.close(keyboard)
        return ended


def played(maker: Maker, page: str) -> str:
    """The page with the outputs of this machine."""

    def block(found: re.Match[str]) -> str:
        if found[2] != "console":
            return found[0]
        lines = (f"{one.typed}\n{maker.types(one)}" for one in steps(found[3]))
        return f"{found[1]}console\n{''.join(lines)}{found[1]}"

    return BLOCK.sub(block, page)


@pytest.mark.thorough
@pytest.mark.timeout(900)
def test_the_first_day_is_as_its_page_shows_it(pytestconfig):
    page = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory(dir=memory_folder()) as folder:
        maker = Maker(Path(folder))
        with maker.trainer:
            now = played(maker, page)
    if pytestconfig.option.write_pages:
        PAGE.write_text(now, encoding="utf-8")
        return
    assert comparable(now) == comparable(page)
