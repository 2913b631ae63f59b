"""One running service for many tests: each says in which mode it begins, and leaves what it did.

Starting drives, core and gateway takes seconds; bringing what lives back into a mode takes one.
"""

from pathlib import Path

from processes import CONFIGS, Service, its_bus

from daemon.record import CycleRecord, Mode
from gaitd.testing.trainer import PATIENCE_S, VirtualTrainer, speeds_by_leg

__all__ = ["ALTERED_CORE", "PATIENCE_S", "WAITING_GATEWAY", "LongService"]

ALTERED_CORE = (str(Path(__file__).with_name("altered_core.py")),)
WAITING_GATEWAY = (str(Path(__file__).with_name("waiting_gateway.py")),)
FAST = (0.5, 0.4)
"""rad/s and m/s: a fault finds the leg in motion."""
QUICKER = {"gait.announce_s": 0.5, "gait.ramp_strides": 1}


class LongService(VirtualTrainer):
    """Virtual drives, core and gateway that live for many tests."""

    ask = Service.ask

    def __init__(
        self, folder: Path, template: str = "demo.toml", *, wall_clock: bool = False
    ) -> None:
        edits = {template: {**its_bus(CONFIGS / template), **QUICKER}}
        super().__init__(
            folder, CONFIGS, trainer_file=template, edits=edits, wall_clock=wall_clock
        )

    def walks(self, record: CycleRecord) -> bool:
        """In a gait, and one leg fast in both axes."""
        return record.mode == Mode.GAIT and any(
            hip > FAST[0] and slide > FAST[1] for hip, slide in speeds_by_leg(record)
        )
