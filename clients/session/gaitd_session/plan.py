"""The blocks of a session in their order, and the limits that an operator releases for them."""

from dataclasses import dataclass
from enum import StrEnum, auto

from gaitd_client import AxisPlan, PlanLimits

from gaitd_session.profile import Profile, Walk


class BlockKind(StrEnum):
    """Part of the plan."""

    PASSIVE = auto()
    """The patient relaxes; what is estimated meanwhile is taken off from then on."""
    WARM_UP = auto()
    WALKING = auto()


@dataclass(frozen=True, slots=True)
class Block:
    """One block of the plan."""

    kind: BlockKind
    walk: Walk


def blocks_of(profile: Profile) -> tuple[Block, ...]:
    """Return the passive minute if there is one, warm-up and blocks; never empty."""
    passive = profile.plan.passive
    return (
        *(() if passive is None else (Block(BlockKind.PASSIVE, passive),)),
        Block(BlockKind.WARM_UP, profile.plan.warm_up),
        *(Block(BlockKind.WALKING, walk) for walk in profile.plan.block),
    )


def limits_of(profile: Profile) -> PlanLimits:
    """Return the narrowest limits within which the service grants every gait of the plan."""
    walks = [block.walk for block in blocks_of(profile)]
    return PlanLimits(
        cadence_max_hz=max(walk.cadence_hz for walk in walks),
        amplitude_max_ratio=max(walk.amplitude_ratio for walk in walks),
        duration_max_s=max(walk.duration_s for walk in walks),
        hip=AxisPlan(assist_max=profile.assist.hip.max_nm),
        slide=AxisPlan(assist_max=profile.assist.slide.max_n),
    )
