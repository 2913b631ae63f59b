"""The service and the virtual drives as the processes that people run, on loopback ports."""

import contextlib
import csv
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import can

from daemon.record import CycleRecord
from daemon.seam import RING_NAME, RingError, RingReader
from gaitd import remote
from gaitd.remote import Target

CONFIGS = Path(__file__).parents[2] / "configs"
POLL_S = 0.02
GAITD = ("-m", "gaitd")
MEMORY = Path("/dev/shm")
"""Truth and ring in memory: a disk that writes back stalls who writes to it for 100 ms."""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Service:
    """Virtual drives, core and gateway, each a process of its own."""

    def __init__(self, folder: Path, configs: Path = CONFIGS, template: str = "demo.toml") -> None:
        self.folder = folder
        self.bus_port, self.zenoh_port = free_port(), free_port()
        self.config = folder / "trainer.toml"
        text = (configs / template).read_text()
        text = re.sub(r"ws://127.0.0.1:\d+/", f"ws://127.0.0.1:{self.bus_port}/", text)
        text = re.sub(r"tcp/127.0.0.1:\d+", f"tcp/127.0.0.1:{self.zenoh_port}", text)
        text = re.sub(r'runtime = "[^"]*"', f'runtime = "{folder}/run"', text)
        text = re.sub(r'state = "[^"]*"', f'state = "{folder}/state"', text)
        text = re.sub(r'"((\w+)\.toml|drives/[^"]*)"', rf'"{configs}/\1"', text)
        self.config.write_text(text)
        self.parts: dict[str, subprocess.Popen[bytes]] = {}

    # --- processes --------------------------------------------------------------------------

    def start(
        self, part: str, *arguments: str, program: Sequence[str] = GAITD
    ) -> subprocess.Popen[bytes]:
        """One part; `program` is what runs `gaitd PART`, where it is not `gaitd` itself."""
        log = (self.folder / f"{part}.log").open("ab")
        with log:
            self.parts[part] = subprocess.Popen(
                [sys.executable, *program, part, "--config", str(self.config), *arguments],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                cwd=self.folder,
            )
        return self.parts[part]

    def start_drives(self) -> None:
        places = ("--truth", str(self.truth_path), "--control", str(self.folder / "ctl"))
        self.start("sim", *places, "--truth-in-silence")
        self.wait(lambda: b"virtual drives" in (self.folder / "sim.log").read_bytes(), 30)

    def start_all(self) -> "Service":
        self.start_drives()
        self.start("core")
        self.start("gateway")
        return self

    def kill(self, part: str, number: int = signal.SIGKILL) -> None:
        os.kill(self.parts[part].pid, number)
        if number == signal.SIGKILL:
            self.parts[part].wait()

    def runs(self, part: str) -> bool:
        return part in self.parts and self.parts[part].poll() is None

    def end(self) -> None:
        for part in reversed(list(self.parts)):
            process = self.parts[part]
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in self.parts.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
            if process.poll() is None:
                process.kill()
                process.wait()

    def log(self, part: str) -> str:
        return (self.folder / f"{part}.log").read_text()

    def ask(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "gaitd", *words, "--config", str(self.config)],
            capture_output=True,
            text=True,
            timeout=90,
            check=False,
        )

    def request(self, name: str, **payload: object) -> dict[str, Any]:
        """As `ask`, without a process of its own: the answer, `unanswered` if there is none."""
        target = Target((f"tcp/127.0.0.1:{self.zenoh_port}",), "trainer")
        answer = remote.ask(target, name, {"client": "tester", **payload} if payload else {})
        return json.loads(answer.text) if answer.text else {"outcome": "unanswered"}

    def inject(self, line: str) -> str:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
            own = self.folder / f"tester{time.monotonic_ns()}"
            end.bind(str(own))
            end.settimeout(5)
            end.sendto(line.encode(), str(self.folder / "ctl"))
            return end.recv(4096).decode()

    # --- witnesses --------------------------------------------------------------------------

    @property
    def truth_path(self) -> Path:
        return self.folder / "truth.csv"

    def wait(self, reached: Callable[[], object], within_s: float, poll_s: float = POLL_S) -> None:
        end_s = time.monotonic() + within_s
        while time.monotonic() < end_s:
            with contextlib.suppress(FileNotFoundError, RingError):
                if reached():
                    return
            time.sleep(poll_s)
        logs = "\n".join(f"--- {part}\n{self.log(part)[-2000:]}" for part in self.parts)
        raise AssertionError(f"not reached within {within_s} s\n{logs}")

    def boot_id(self) -> str:
        """Of the core that wrote the ring; empty where there is none yet."""
        try:
            with contextlib.closing(RingReader(self.folder / "run" / RING_NAME)) as ring:
                return ring.header.core_boot_id
        except FileNotFoundError:
            return ""

    def newest(self) -> CycleRecord:
        with contextlib.closing(RingReader(self.folder / "run" / RING_NAME)) as ring:
            record = ring.read(ring.newest_seq())
        if record is None:
            raise FileNotFoundError("no record yet")
        return record

    def records(self, after_seq: int = 0) -> list[CycleRecord]:
        with contextlib.closing(RingReader(self.folder / "run" / RING_NAME)) as ring:
            return ring.since(after_seq)

    def until(self, reached: Callable[[CycleRecord], bool], within_s: float = 30) -> CycleRecord:
        self.wait(lambda: reached(self.newest()), within_s)
        return self.newest()

    def truth(self) -> list[dict[str, str]]:
        with self.truth_path.open() as file:
            return [row for row in csv.DictReader(file) if row["programme"]]

    @contextlib.contextmanager
    def listener(self) -> Iterator[can.BusABC]:
        """A station of python-can on the same bus, that only listens."""
        with can.Bus(interface="remote", channel=f"ws://127.0.0.1:{self.bus_port}/") as bus:
            yield bus
