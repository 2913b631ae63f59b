"""One running service for many tests: each says in which mode it begins, and leaves what it did.

Starting drives, core and gateway takes seconds; bringing what lives back into a mode takes one.
"""

import contextlib
import tempfile
from collections.abc import Generator
from pathlib import Path
from typing import Self

from gaitd_names import Mode
from processes import CONFIGS, Service, its_bus

from daemon.ipc.record import CycleRecord
from gaitd_lab.processes import memory_folder
from gaitd_lab.testing.trainer import TIMEOUT_S, VirtualTrainer, speeds_by_leg

__all__ = ["ALTERED_CORE", "TIMEOUT_S", "WAITING_GATEWAY", "LongService", "long_lived"]

ALTERED_CORE = (str(Path(__file__).with_name("altered_core.py")),)
WAITING_GATEWAY = (str(Path(__file__).with_name("waiting_gateway.py")),)
FAST = (0.5, 0.4)
"""rad/s and m/s: a fault finds the leg in motion."""
QUICKER = {
    "gait.announce_s": 0.5,
    "gait.ramp_strides": 1,
    "gait.hip.approach_rad_per_s": 0.8,
    "gait.slide.approach_m_per_s": 0.6,
}
CADENCE_HZ = 0.45
"""The leg is fast soon. At 0.5 Hz a leg that is switched off in the fastest part of its stride is
too fast to stop within its range (STOPPING_PATH)."""


class LongService(VirtualTrainer):
    """Virtual drives, core and gateway that live for many tests, and compute nothing in between."""

    ask, ran = Service.ask, Service.ran

    def __init__(self, folder: Path, template: str = "demo.toml") -> None:
        edits = {template: {**its_bus(CONFIGS / template), **QUICKER}}
        super().__init__(folder, CONFIGS, trainer_file=template, edits=edits)
        self._rest = contextlib.ExitStack()

    def rest(self) -> None:
        """Let simulated time stand until the next `bring`."""
        self._rest.close()
        if self.is_on_simulated_bus and self.runs("sim"):
            self._rest.enter_context(self.held())

    def bring(self, mode: Mode, **wanted: object) -> Self:
        """As `VirtualTrainer.bring`, into a quick gait."""
        self._rest.close()
        return super().bring(mode, **{"cadence_hz": CADENCE_HZ, **wanted})

    def walks(self, record: CycleRecord) -> bool:
        """In a gait, and one leg fast in both axes."""
        return record.mode == Mode.GAIT and any(
            hip > FAST[0] and slide > FAST[1] for hip, slide in speeds_by_leg(record)
        )


@contextlib.contextmanager
def long_lived(template: str = "demo.toml") -> Generator[LongService]:
    """One that has not begun; `bring` starts what does not run."""
    with tempfile.TemporaryDirectory(dir=memory_folder()) as folder:
        service = LongService(Path(folder), template)
        try:
            yield service
        finally:
            service.end()
