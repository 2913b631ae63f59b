"""Session after session, until the simulated time is over."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from daemon.config.load import load
from gaitd.random_hour.session import RandomSession
from gaitd.random_hour.tally import Tally
from gaitd.random_hour.variants import variant_of, written


class Played(NamedTuple):
    """One session that is over."""

    seed: int
    variant: str
    tally: Tally


def sessions(configs: Path, seed: int, duration_s: float, session_s: float) -> Iterator[Played]:
    """Play sessions of at most `session_s` until `duration_s` is over.

    Args:
        configs: folder of the shipped configuration.
        seed: of the first session; each next one has the next.
        duration_s: of simulated time, of all.
        session_s: of one.
    """
    left_s = duration_s
    while left_s > 0:
        played = session(configs, seed, min(left_s, session_s))
        yield played
        left_s -= session_s
        seed += 1


def session(configs: Path, seed: int, duration_s: float) -> Played:
    """Play one session."""
    variant = variant_of(seed)
    with tempfile.TemporaryDirectory() as folder:
        settings = load(written(variant, configs, Path(folder) / "configs"))
        tally = RandomSession(settings, seed, variant.name, duration_s).run()
    return Played(seed, variant.name, tally)
