"""The part of the configuration that the core uses; constant while the core runs."""

from dataclasses import dataclass

from daemon.config.settings import Excite, Gait, HandGuiding, Impedance, SelfTest
from daemon.core.motion.assist import AssistRules
from daemon.core.safety.limits import Categories, Thresholds
from daemon.core.safety.spasm import SpasmRules
from daemon.core.safety.stop_sequence import StopRules


@dataclass(frozen=True, slots=True)
class CoreConfig:
    """Settings in SI units and cycles, as `runtime/build.py` derives them from the files."""

    period_ns: int
    period_s: float
    """Nominal time between two SYNCs."""
    thresholds: Thresholds
    categories: Categories
    stop_rules: StopRules
    spasm: SpasmRules
    assist_rules: AssistRules
    hold: Impedance
    gait: Gait
    excite: dict[str, Excite]
    hand_guiding: HandGuiding
    self_test: SelfTest
    leg_digest: str
    """Digest of robot.toml: a self-test is valid for one leg and one machine only."""
    patient_configured: bool
    signs_must_be_proven: bool

    @property
    def by_position(self) -> bool:
        """The drives' own position loops follow the reference of a gait."""
        return self.gait.guidance == "position"
