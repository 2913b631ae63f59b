"""The service and the virtual drives as the processes that people run.

The processes are those of the plugin that gaitd ships; here is only what our own tests want more.
"""

import subprocess
import sys
import tomllib
from pathlib import Path

import command_line

from gaitd_lab import processes
from gaitd_lab.processes import GAITD
from gaitd_lab.testing import service

CONFIGS = Path(__file__).parents[2] / "configs"


class Service(service.Service):
    """Virtual drives, core and gateway, each a process of its own."""

    def __init__(
        self,
        folder: Path,
        configs: Path = CONFIGS,
        template: str = "demo.toml",
        pace: float | str = service.REAL_TIME,
    ) -> None:
        edits = {template: its_bus(configs / template)}
        super().__init__(folder, configs, trainer_file=template, edits=edits, pace=pace)

    def ask(self, *words: str) -> command_line.Ended:
        """As a person does: by the command line, without a process of its own."""
        return command_line.gaitd(*words, "--config", self.config)

    def ran(self, part: str) -> tuple[int, str]:
        """Run another part as a process of its own to its end: exit code, and what it said."""
        words = (*GAITD, part, "--config", str(self.config))
        process = processes.ManagedProcess(part, words, self.folder / f"another_{part}.log")
        try:
            process.wait(90)
        finally:
            code = process.end()
        return code, process.output()


def gaitd(*words: str, timeout: float = 90) -> subprocess.CompletedProcess[str]:
    """A command as a process of its own."""
    command = [sys.executable, *GAITD, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


def its_bus(template: Path) -> dict[str, str]:
    """A bus of the kernel's is used as the file has it; only a simulated one is of ours."""
    bus = tomllib.loads(template.read_text())["bus"]
    kept = {f"bus.{key}": bus[key] for key in ("interface", "channel")}
    return kept if bus["interface"] == "socketcan" else {}
