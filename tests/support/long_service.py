"""One running service for many tests: each says in which mode it begins, and leaves what it did.

Starting drives, core and gateway takes seconds; bringing what lives back into a mode takes one.
A machine that stalls for 100 ms makes the drives stop, rightly; here it is only in the way, so a
mode is asked for again.
"""

import signal
from pathlib import Path
from typing import Any

from processes import Service
from sessions import changed_configs
from witnesses import STANDSTILL

from daemon.record import CycleRecord, Mode

ALTERED_CORE = (str(Path(__file__).with_name("altered_core.py")),)
WAITING_GATEWAY = (str(Path(__file__).with_name("waiting_gateway.py")),)
TRIES = 4
PATIENCE_S = 90
"""Of a machine on which much else runs, for a start that takes three seconds of computing."""
GAIT = {"mode": "gait", "cadence_hz": 0.4, "amplitude_ratio": 1.0, "duration_s": 600.0}
HOLD = {"mode": "hold"}
SETTLED = {Mode.READY, Mode.FAULT, Mode.HOLD, Mode.GAIT}
FAST = (0.5, 0.4)
"""rad/s and m/s: a fault finds the leg in motion."""


class LongService(Service):
    """Virtual drives, core and gateway that live for many tests."""

    def __init__(self, folder: Path, template: str = "demo.toml") -> None:
        configs = changed_configs(
            folder,
            (template, "announce_s = 3.0", "announce_s = 0.5"),
            (template, "ramp_strides = 2", "ramp_strides = 1"),
        )
        super().__init__(folder, configs, template)

    def bring(self, mode: Mode) -> "LongService":
        """Into READY, HOLD or GAIT, from wherever it is; what does not run is started."""
        self.refused: list[dict[str, Any]] = []
        for _ in range(TRIES):
            self._revive()
            self.wait(self._is_heard, PATIENCE_S)
            record = self.until(lambda record: record.mode in SETTLED, PATIENCE_S)
            if record.mode == Mode.FAULT:
                self.wait(lambda: self._done("reset"), PATIENCE_S)
                record = self.until(lambda record: record.mode == Mode.READY, PATIENCE_S)
            if record.mode != mode and self._ask_for(mode, record):
                record = self.newest()
            if record.mode == mode:
                if mode == Mode.GAIT:
                    record = self.until(lambda one: walks(one) or one.mode != mode, PATIENCE_S)
                if record.mode == mode:
                    return self
        raise AssertionError(f"never in {mode.name}: {self.newest().verdict}, {self.refused}")

    def _revive(self) -> None:
        if not self.runs("sim"):
            for part in ("core", "gateway"):
                if self.runs(part):
                    self.kill(part)
            self.start_drives()
        if not self.runs("core"):
            before = self.boot_id()
            self.start("core")
            self.wait(lambda: self.boot_id() not in {before, ""}, PATIENCE_S)
        if not self.runs("gateway"):
            self.start("gateway")
        for part in ("core", "gateway"):
            self.kill(part, signal.SIGCONT)

    def _is_heard(self) -> bool:
        """The gateway that runs now hears the core that runs now."""
        answer = self.request("status")
        valid = answer.get("safety", {}).get("valid", False)
        return valid and answer["core_boot_id"] == self.boot_id()

    def _ask_for(self, mode: Mode, record: CycleRecord) -> bool:
        if mode == Mode.READY:
            return self._done("disable")
        if record.mode == Mode.READY:
            # After a reset the leg falls into its springs first; refused while it moves.
            self.wait(lambda: self._done("enable"), PATIENCE_S)
        wanted = HOLD if mode == Mode.HOLD else GAIT
        if self.newest().mode != mode and not self._done("mode", **wanted):
            return False
        reached = walks if mode == Mode.GAIT else stands
        over = self.until(lambda one: reached(one) or one.mode == Mode.FAULT, PATIENCE_S)
        return over.mode == mode

    def _done(self, name: str, **payload: object) -> bool:
        answer = self.request(name, **payload)
        self.refused += [answer] if answer["outcome"] != "done" else []
        return answer["outcome"] == "done"


def walks(record: CycleRecord) -> bool:
    """In a gait, and one leg fast in both axes."""
    return record.mode == Mode.GAIT and any(
        hip > FAST[0] and slide > FAST[1] for hip, slide in speeds_by_leg(record)
    )


def stands(record: CycleRecord) -> bool:
    return record.mode == Mode.HOLD and all(
        hip < STANDSTILL[0] and slide < STANDSTILL[1] for hip, slide in speeds_by_leg(record)
    )


def speeds_by_leg(record: CycleRecord) -> list[tuple[float, float]]:
    """How fast the hip and the slide of each leg are, either way."""
    speeds = [abs(drive.velocity_si or 0.0) for drive in record.drives]
    return list(zip(speeds[::2], speeds[1::2], strict=True))
