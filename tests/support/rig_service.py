"""The service inside the rig's small world: one Python that imports and warms once, then forks.

    python rig_service.py warm                  compile what the service needs (on the host, too)
    python rig_service.py FOLDER SCENARIO ...   run these of `scenarios.py`; results in FOLDER

One part is none of gaitd's: "bench_motor", the real drive beside a virtual one.

In the virtual machine an import of numpy and numba costs half a minute. So the programs that
people start (`gaitd sim`, `gaitd core`, `gaitd gateway`) are forked from this process and run
`gaitd`'s own entry point with the words of their command line; from there on they are what they
always are.

Waiting for the host's disk lets the guest's clock run away (it counts instructions), so everything
that runs has its files in the guest's memory, and waits here are generous: what is asserted later
is counted in cycles, or measured by candump's stamps.
"""

import gc
import json
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from as_program import exit_code_of
from command_line import gaitd
from processes import Service

from daemon.preflight.load import load
from gaitd_lab.processes import ManagedProcess

CONFIGS = Path(__file__).parents[2] / "configs"
TIMEOUT_S = 600
POLL_S = 0.1
TEMPLATE = "vcan.toml"
# One slow processor for drives and core: two drives answer in 3.9 ms at worst, four in twice that.
WINDOW_MS = 5.0


class Forked(ManagedProcess):
    """A child that runs `gaitd WORDS`, forked from this process instead of executed."""

    def __init__(self, words: list[str], log: Path) -> None:
        sys.stdout.flush()
        self.name, self._log, self._begin = f"gaitd {words[0]}", log, 0
        self.stdin = self.returncode = None
        self.pid = os.fork()
        if self.pid == 0:
            os._exit(_run(words, log))

    def poll(self) -> int | None:
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout: float | None = TIMEOUT_S) -> int:
        within_s = timeout or TIMEOUT_S
        end_s = time.monotonic() + within_s
        while self.poll() is None:
            if time.monotonic() > end_s:
                raise subprocess.TimeoutExpired(f"process {self.pid}", within_s)
            time.sleep(POLL_S)
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)


def _run(words: list[str], log: Path) -> int:
    """What the `gaitd` script does, in a child that inherits nothing but warm code."""
    import bench_motor

    from gaitd.__main__ import main

    end = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    null = os.open(os.devnull, os.O_RDONLY)
    for number, target in ((0, null), (1, end), (2, end)):
        os.dup2(target, number)
    sys.argv = ["gaitd", *words]

    def program() -> None:
        if words[0] == "bench_motor":
            os.nice(-10)  # one slow processor for all; a real drive has its own
            bench_motor.play(Path(words[-1]))
        main()

    return exit_code_of(program)


class Inside(Service):
    """Virtual drives, core and gateway as forks, on an interface of this world."""

    def __init__(self, folder: Path, template: Path = CONFIGS / TEMPLATE, **channels: str) -> None:
        """`channels`: of a part that is not on vcan0, such as sim="can1"."""
        folder.mkdir(parents=True)
        super().__init__(folder, template.parent, template.name)
        self.channels = channels
        text = self.config.read_text()
        text = text.replace("announce_s = 3.0", "announce_s = 0.5")
        text = text.replace("ramp_strides = 2", "ramp_strides = 1")
        self.text = text.replace("window_ms = 4.0", f"window_ms = {WINDOW_MS}")
        self.config.write_text(self.text)
        load(self.config)

    def start(self, part: str, *arguments: str, program: Any = None) -> Any:
        del program
        config = self.config.with_name(f"{part}.toml")
        channel = self.channels.get(part, "vcan0")
        bench = "" if channel == "vcan0" else "\nvirtual_drives = true"
        config.write_text(self.text.replace('"vcan0"', f'"{channel}"{bench}'))
        words = [part, "--config", str(config), *arguments]
        self.parts[part] = Forked(words, self.folder / f"{part}.log")
        return self.parts[part]

    def wait(self, reached: Any, within_s: float = TIMEOUT_S, poll_s: float = POLL_S) -> None:
        super().wait(reached, max(within_s, TIMEOUT_S), max(poll_s, POLL_S))

    def done(self, name: str, **payload: object) -> dict[str, Any]:
        """Ask until it is done; what it said at last."""
        answers: list[dict[str, Any]] = []

        def asked() -> bool:
            answers.append(self.request(name, **payload))
            return answers[-1]["outcome"] == "done"

        self.wait(asked)
        return answers[-1]


class Report:
    """What a scenario has seen, for the tests on the host."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        kept = folder / "facts.json"
        self.facts: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() else {}

    def __setitem__(self, name: str, fact: Any) -> None:
        self.facts[name] = fact
        print(f"{time.monotonic():.3f} {name}", flush=True)
        (self.folder / "facts.json").write_text(json.dumps(self.facts))

    def keep_records(self, name: str, service: Service, after_seq: int) -> None:
        """The records that the ring holds, as msgpack."""
        records = service.records(after_seq)
        (self.folder / f"{name}.records").write_bytes(msgspec.msgpack.encode(records))


def warm() -> None:
    """Import and compile what the parts of the service use."""
    from daemon.core.modes.persistent_state import PersistentState
    from daemon.core.runtime.build import build
    from daemon.core.runtime.warm_up import warm_up
    from daemon.preflight.acceptance import accepted
    from gaitd_lab.virtual_machine import virtual_machine

    settings = accepted(CONFIGS / TEMPLATE)
    assert gaitd("check", "--config", CONFIGS / TEMPLATE).code == 0  # loads the command line
    warm_up(build(settings, "warm", PersistentState()))
    virtual_machine(settings.file).world.advance_to(20_000_000)


def _import_all() -> None:
    import importlib

    for name in (
        "gaitd.core",
        "gaitd.gateway",
        "gaitd.status",
        "gaitd.remote",
        "gaitd_lab.commands.sim",
        "can.interfaces.socketcan",
        "daemon.gateway.process",
        "daemon.core.runtime.process",
    ):
        importlib.import_module(name)
    importlib.import_module("sim_drives.time.wall_clock")


def main() -> None:
    _import_all()
    warm()
    if sys.argv[1:] == ["warm"]:
        return
    import scenarios

    gc.freeze()
    folder = Path(sys.argv[1])
    Report(folder)["warm"] = time.monotonic()
    sys.exit(sum(_play(getattr(scenarios, name), folder) for name in sys.argv[2:]))


def _play(scenario: Callable[[Report], None], folder: Path) -> bool:
    """Whether it failed; the next one is worth seeing all the same.

    In a process of its own: who has once talked Zenoh has threads, and must not fork any more.
    """
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        return os.waitpid(pid, 0)[1] != 0
    begun_s, code, report = time.monotonic(), 0, Report(folder)
    try:
        scenario(report)
    except Exception:  # noqa: BLE001 - its traceback is printed, and the exit code says so
        traceback.print_exc()
        code = 1
    report[f"{scenario.__name__}_s"] = time.monotonic() - begun_s
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
