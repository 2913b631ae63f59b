"""The stage of an act: a folder of its own, free ports, virtual drives and service as processes.

Nothing outlives an act. The processes get SIGTERM in their order, SIGKILL when their time is over,
and SIGTERM from the kernel should the demonstration itself be killed.
"""

import contextlib
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import tomllib
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from daemon.config.robot import leg_parameters
from daemon.config.settings import Robot
from daemon.seam import RING_NAME, RingError, RingReader
from gaitd.children import free_ports, memory_folder, tied
from gaitd.demonstration.script import SILENCE_MAX_S, ActError
from gaitd.held_up import OBSERVER_LOOK_BACK_CYCLES, held_up
from gaitd.remote import Target
from observer.mechanism import gravity

SERVICE_END_S: Final = 15.0
"""The service stops both axes before it ends."""
DRIVES_END_S: Final = 5.0
TAIL_LINES: Final = 12
LOOK_BACK_CYCLES: Final = OBSERVER_LOOK_BACK_CYCLES + round(SILENCE_MAX_S * 100)
"""A silence of the service is noticed late."""


@dataclass(frozen=True, slots=True)
class Stage:
    """Where everything of one act is."""

    folder: Path
    config: Path
    truth: Path
    control: Path
    """Socket of the virtual drives: faults and the patient, by command."""
    target: Target
    leg: str
    drives: "Troupe"
    service: "Troupe"

    def patient(self, programme: str) -> None:
        """Start one of the patient's programmes."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.sendto(f"patient {programme}".encode(), str(self.control))

    def check(self) -> None:
        """Both processes live.

        Raises:
            ActError: one has ended, with the last lines that it said.
        """
        for troupe in (self.drives, self.service):
            troupe.check()

    @contextlib.contextmanager
    def excused(self) -> Generator[None]:
        """What ends the act says how this computer was, unless it is that a process ended."""
        try:
            yield
        except ActError as error:
            if self.drives.exit_code() is None and self.service.exit_code() is None:
                error.held_up = of_late(self.folder / "run" / RING_NAME)
            raise


class Troupe:
    """One process with its output in a file."""

    def __init__(
        self,
        name: str,
        arguments: list[str],
        log: Path,
        program: tuple[str, ...] = ("-m", "gaitd"),
    ) -> None:
        """Start `python PROGRAM ARGUMENTS` in a session of its own: Ctrl-C reaches us alone."""
        self._name = name
        self._log = log
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                tied(*program, *arguments),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def check(self) -> None:
        """It lives.

        Raises:
            ActError: it does not.
        """
        code = self._process.poll()
        if code is not None:
            raise ActError(f"{self._name} ended with {code}; its last words:\n{self.last_words()}")

    def exit_code(self) -> int | None:
        """None while it lives."""
        return self._process.poll()

    def signal(self, number: int) -> None:
        """Send it a signal; after its end this does nothing."""
        self._process.send_signal(number)

    def last_words(self) -> str:
        """The end of its output."""
        lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-TAIL_LINES:]) or "    (nothing)"

    def end(self, patience_s: float) -> int:
        """End it and return its exit code."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
            try:
                self._process.wait(patience_s)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        return self._process.returncode


@contextlib.contextmanager
def stage(configs: Path, *, empty: bool) -> Generator[Stage]:
    """Everything of one act, started; ended whatever happens.

    Args:
        configs: the project's folder of configurations.
        empty: nobody is in the trainer, and its springs carry it alone.
    """
    folder = Path(tempfile.mkdtemp(prefix="gaitd-demo-", dir=memory_folder()))
    with contextlib.ExitStack() as ending:
        ending.push(_tidy(folder))
        config, endpoint = write_configs(configs, folder / "configs", empty=empty)
        truth, control = folder / "truth.csv", folder / "sim.sock"
        drives = Troupe(
            "gaitd sim",
            ["sim", "--config", str(config), "--truth", str(truth), "--control", str(control)],
            folder / "sim.log",
        )
        ending.callback(drives.end, DRIVES_END_S)
        service = Troupe("gaitd run", ["run", "--config", str(config)], folder / "run.log")
        ending.callback(service.end, SERVICE_END_S)
        table = tomllib.loads(config.read_text(encoding="utf-8"))
        target = Target((endpoint,), table["zenoh"]["trainer"])
        leg = table["leg"][0]["name"]
        yield Stage(folder, config, truth, control, target, leg, drives, service)


def of_late(records: Path) -> tuple[str, ...]:
    """How this computer held the core of a ring up, in words; empty if it did not."""
    try:
        with contextlib.closing(RingReader(records)) as ring:
            newest = ring.since(ring.newest_seq() - LOOK_BACK_CYCLES)
    except (FileNotFoundError, RingError):
        return ()
    return tuple(held_up(newest))


def _tidy(folder: Path) -> Callable[..., bool]:
    """Removes the folder of an act that went well; after trouble it stays, which the error says."""

    def leave(_kind: type[BaseException] | None, error: BaseException | None, _: object) -> bool:
        if isinstance(error, ActError):
            error.folder = folder
        else:
            shutil.rmtree(folder, ignore_errors=True)
        return False

    return leave


def write_configs(configs: Path, folder: Path, *, empty: bool) -> tuple[Path, str]:
    """Copy the configurations, with ports that are free and paths of this act.

    Returns: the trainer file, and the Zenoh endpoint it listens on.
    """
    shutil.copytree(configs, folder)
    bus_port, zenoh_port = free_ports(2)
    endpoint = f"tcp/127.0.0.1:{zenoh_port}"
    trainer, plant = folder / "demo.toml", folder / "plant.toml"
    values = {
        "channel": f'"ws://127.0.0.1:{bus_port}/"',
        "listen": f'["{endpoint}"]',
        "runtime": '"../run"',
        "state": '"../state"',
    }
    if empty:
        balance(folder / "robot_empty.toml", plant)
        values["robot"] = '"robot_empty.toml"'
        rewrite(plant, {"robot": '"robot_empty.toml"'})
    rewrite(trainer, values)
    return trainer, endpoint


def balance(robot_file: Path, plant_file: Path) -> None:
    """Turn the springs until they carry the machine where the virtual drives start it.

    Springs set for a patient push the empty machine up to its stop, as its file says; whoever runs
    an experiment on it turns them down first.
    """
    text = robot_file.read_text(encoding="utf-8")
    robot = msgspec.toml.decode(text, type=Robot)
    start = tomllib.loads(plant_file.read_text(encoding="utf-8"))["start"]
    pose = np.array((np.radians(start["hip_deg"]), start["slide_m"]))
    load = gravity(leg_parameters(robot), pose)
    springs = robot.springs
    hip_rest_rad = springs.hip_rest_rad + load[0] / springs.hip_stiffness_nm_per_rad
    slide_rest_m = springs.slide_rest_m + load[1] / springs.slide_stiffness_n_per_m
    rewrite(
        robot_file,
        {"hip_rest_rad": f"{hip_rest_rad:.6f}", "slide_rest_m": f"{slide_rest_m:.6f}"},
    )


def rewrite(file: Path, values: dict[str, str]) -> None:
    """Give keys that stand once in a TOML file other values; comments stay."""
    text = file.read_text(encoding="utf-8")
    for key, value in values.items():
        text, count = re.subn(
            rf"^{key}(\s*)=[^#\n]*", lambda _, k=key, v=value: f"{k} = {v}  ", text, flags=re.M
        )
        if count != 1:
            raise ValueError(f"{file.name} has {count} lines with the key {key}, 1 was expected")
    file.write_text(text, encoding="utf-8")
