"""What a dead core can do: the computed bound against the plant, with a rogue in the core's place.

The rogue drives both joints with all the torque that the limits in the drives leave, and dies just
after a SYNC and a heartbeat, so that the drives' detection takes its full time.
"""

from dataclasses import dataclass
from pathlib import Path

import pytest
from rogue_master import NODES, Rogue
from sessions import changed_configs, elmo_drives, elsewhere, generic_drives, new_session

from daemon.config.bundle import Settings
from daemon.config.drive_plan import drive_limits
from daemon.config.robot import friction_parameters, leg_parameters
from daemon.preflight.load import load
from daemon.preflight.runaway import Run, run_away
from daemon.preflight.runaway_report import axis_runaway, runaway_errors, runaway_meanings
from daemon.preflight.workspace import Motion
from gaitd_lab.lockstep import LockstepSession

LIFE_MS = 700
"""Detection, ramp and rest. A leg without power then drifts into its springs: no torque of a dead
core, and `gaitd check` says how far."""
FULL_PERMILLE = 3000
SIGN_OF_COUNTS = (1, -1)
"""Signs of hip and slide: counts of the slide fall along its positive axis."""
LEAST_RATIO = {"epos4": 0.6, "generic": 0.25}
"""Part of the bound that the plant must reach; a drive's response is a large part of 30 ms."""
IN_THE_OPEN_N = 1.0
"""A contact force below is none: the leg met no end of the machine."""


@dataclass(frozen=True)
class Death:
    """One end of a core."""

    signs: tuple[int, int]
    cycles: int
    """Cycles of full torque before the master dies."""


IN_THE_OPEN = (Death((1, 1), 1), Death((1, -1), 1), Death((-1, 1), 1), Death((-1, -1), 1))
"""No more than one of these meets an end of the machine."""
FAST = (Death((1, -1), 9), Death((-1, 1), 9))


def dead_core(session: LockstepSession, death: Death) -> list:
    """What the leg does."""
    rogue = Rogue(session)
    rogue.cycles(2)
    for node, sign, counts in zip(NODES, death.signs, SIGN_OF_COUNTS, strict=True):
        rogue.commands[node].torque = sign * counts * FULL_PERMILLE
    rogue.cycles(1 + death.cycles)  # a target acts from the next SYNC on
    return rogue.die(LIFE_MS)


@pytest.fixture(scope="module")
def warm_epos4() -> LockstepSession:
    return new_session().enable()


@pytest.fixture(scope="module")
def warm_generic(tmp_path_factory) -> LockstepSession:
    return new_session(generic_drives(tmp_path_factory.mktemp("generic"))).enable()


@pytest.fixture(scope="module")
def epos4_meanings(warm_epos4) -> list:
    return runaway_meanings(warm_epos4.settings)


@pytest.fixture(scope="module")
def generic_meanings(warm_generic) -> list:
    return runaway_meanings(warm_generic.settings)


def distances(path: list) -> tuple[float, float]:
    hip, slide = (
        max(abs(truth.position[axis] - path[0].position[axis]) for truth in path) for axis in (0, 1)
    )
    return hip, slide


def computed(settings: Settings, path: list, death: Death) -> Run:
    """The bound for this one start, unless the stretched leg ended it."""
    hip, slide = drive_limits(settings.limits)
    leg, cycle = settings.legs[0], settings.trainer.cycle
    return run_away(
        leg_parameters(settings.robot),
        friction_parameters(settings.robot),
        Motion(path[0].position, path[0].velocity),
        (float(death.signs[0]), float(death.signs[1])),
        (axis_runaway(leg.hip, hip, cycle), axis_runaway(leg.slide, slide, cycle)),
        settings.limits.singularity.stop_ratio,
    )


def in_the_open(path: list) -> bool:
    return all(abs(force) < IN_THE_OPEN_N for truth in path for force in truth.contact)


@pytest.mark.parametrize(
    ("make", "deaths"),
    [("epos4", IN_THE_OPEN), ("epos4", FAST), ("generic", (*IN_THE_OPEN[:2], FAST[0]))],
)
def test_a_dead_core_runs_no_farther_than_computed_and_not_absurdly_less(
    warm_epos4, warm_generic, epos4_meanings, generic_meanings, make, deaths
):
    session, meanings = {
        "epos4": (warm_epos4, epos4_meanings),
        "generic": (warm_generic, generic_meanings),
    }[make]
    paths = [elsewhere(session, lambda one, death=death: dead_core(one, death)) for death in deaths]
    for death, path in zip(deaths, paths, strict=True):
        found, run = distances(path), computed(session.settings, path, death)
        assert [abs(effort) for effort in path[0].effort] == pytest.approx([62.0, 480.0], rel=0.01)
        for axis in (0, 1):
            assert found[axis] <= meanings[axis].distance_si
            if in_the_open(path) and not run.ends_stretched:
                assert LEAST_RATIO[make] * run.distance[axis] <= found[axis] <= run.distance[axis]
    assert sum(map(in_the_open, paths)) >= 3 or deaths is not IN_THE_OPEN


def limited(tmp_path: Path, *changes: tuple[str, str, str]) -> Settings:
    return load(changed_configs(tmp_path, *changes) / "demo.toml")


def test_a_torque_limit_that_runs_too_far_is_refused_with_what_would_be_allowed(tmp_path):
    change = ("limits.toml", "max_runaway_deg = 70.0", "max_runaway_deg = 62.0")
    limit = "torque_max_nm = 62.0"
    settings = limited(tmp_path, change)

    refused = next(runaway_errors(settings, runaway_meanings(settings)))

    assert (refused.file, refused.key) == (str(settings.file.limits), "hip.torque_max_nm")
    assert "N m: " in refused.allowed
    assert "max_runaway" in refused.allowed
    allowed = refused.allowed.split()[1]
    assert 0 < float(allowed) < 62.0
    less = limited(tmp_path / "less", change, ("limits.toml", limit, f"torque_max_nm = {allowed}"))
    assert not list(runaway_errors(less, runaway_meanings(less)))


def test_a_drive_that_notices_sooner_may_have_more_torque(epos4_meanings, generic_meanings):
    late, soon = epos4_meanings, generic_meanings

    assert [axis.detection_ms for axis in late] == [100, 100]
    assert [axis.detection_ms for axis in soon] == [30, 30]
    for slow, quick in zip(late, soon, strict=True):
        assert quick.distance_si < 0.75 * slow.distance_si


def test_drives_that_keep_no_speed_limit_are_refused_with_the_shipped_torque(tmp_path):
    settings = load(elmo_drives(tmp_path) / "demo.toml")

    hip, slide = runaway_errors(settings, runaway_meanings(settings))

    assert "enforces no speed limit" in hip.allowed
    assert slide.allowed.startswith("<= 150 N: ")
