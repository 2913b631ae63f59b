"""One running service for many tests: each says in which mode it begins, and leaves what it did.

Starting drives, core and gateway takes seconds; bringing what lives back into a mode takes one.
A machine that stalls for 100 ms makes the drives stop, rightly; here it is only in the way, so a
mode is asked for again.
"""

import signal
from pathlib import Path

from processes import Service
from sessions import changed_configs
from witnesses import STANDSTILL

from daemon.record import CycleRecord, Mode

TRIES = 4
GAIT = {"mode": "gait", "cadence_hz": 0.4, "amplitude_ratio": 1.0, "duration_s": 600.0}
HOLD = {"mode": "hold"}
SETTLED = {Mode.READY, Mode.FAULT, Mode.HOLD, Mode.GAIT}
FAST = (0.5, 0.4)
"""rad/s and m/s: a fault finds the leg in motion."""


class LongService(Service):
    """Virtual drives, core and gateway that live for many tests."""

    def __init__(self, folder: Path) -> None:
        configs = changed_configs(
            folder,
            ("demo.toml", "announce_s = 3.0", "announce_s = 0.5"),
            ("demo.toml", "ramp_strides = 2", "ramp_strides = 1"),
        )
        super().__init__(folder, configs)

    def bring(self, mode: Mode) -> "LongService":
        """Into READY, HOLD or GAIT, from wherever it is; what does not run is started."""
        for _ in range(TRIES):
            self._revive()
            self.wait(lambda: self.request("status").get("safety", {}).get("valid"), 30)
            record = self.until(lambda record: record.mode in SETTLED, 40)
            if record.mode == Mode.FAULT:
                self.wait(lambda: self.request("reset")["outcome"] == "done", 20)
                record = self.until(lambda record: record.mode == Mode.READY, 20)
            if record.mode != mode and self._ask_for(mode, record):
                record = self.newest()
            if record.mode == mode:
                if mode == Mode.GAIT:
                    record = self.until(lambda one: walks(one) or one.mode == Mode.FAULT)
                if record.mode == mode:
                    return self
        raise AssertionError(f"never in {mode.name}: {self.newest().verdict}")

    def _revive(self) -> None:
        if not self.runs("sim"):
            for part in ("core", "gateway"):
                if self.runs(part):
                    self.kill(part)
            self.start_drives()
        for part in ("core", "gateway"):
            if not self.runs(part):
                self.start(part)
            self.kill(part, signal.SIGCONT)

    def _ask_for(self, mode: Mode, record: CycleRecord) -> bool:
        if mode == Mode.READY:
            return self.request("disable")["outcome"] == "done"
        if record.mode == Mode.READY and self.request("enable")["outcome"] != "done":
            return False
        wanted = HOLD if mode == Mode.HOLD else GAIT
        if self.newest().mode != mode and self.request("mode", **wanted)["outcome"] != "done":
            return False
        reached = walks if mode == Mode.GAIT else stands
        return self.until(lambda one: reached(one) or one.mode == Mode.FAULT).mode == mode


def walks(record: CycleRecord) -> bool:
    speeds = [abs(drive.velocity_si or 0.0) for drive in record.drives]
    fast = all(speed > limit for speed, limit in zip(speeds, FAST, strict=True))
    return record.mode == Mode.GAIT and fast


def stands(record: CycleRecord) -> bool:
    speeds = [abs(drive.velocity_si or 0.0) for drive in record.drives]
    still = all(speed < limit for speed, limit in zip(speeds, STANDSTILL, strict=True))
    return record.mode == Mode.HOLD and still
