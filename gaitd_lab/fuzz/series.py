"""Runs session after session, until the simulated time is over."""

import math
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from daemon.preflight.load import load
from gaitd_lab.fuzz.session import RandomSession
from gaitd_lab.fuzz.tally import Tally
from gaitd_lab.fuzz.variants import variant_of, written


class Played(NamedTuple):
    """A finished session."""

    seed: int
    variant: str
    tally: Tally


def sessions(
    configs: Path, seed: int, duration_s: float, session_s: float, process_count: int = 1
) -> Iterator[Played]:
    """Run sessions of at most `session_s` until `duration_s` is over.

    Args:
        configs: folder of the shipped configuration.
        seed: seed of the first session; each next session has the next seed.
        duration_s: simulated time of all sessions.
        session_s: simulated time of one session.
        process_count: number of processes; the sessions do not depend on it.
    """
    count = math.ceil(duration_s / session_s)
    seeds = range(seed, seed + count)
    lengths = [min(duration_s - number * session_s, session_s) for number in range(count)]
    play = partial(session, configs)
    if process_count == 1:
        yield from map(play, seeds, lengths)
        return
    with ProcessPoolExecutor(process_count, mp_context=get_context("fork")) as pool:
        yield from pool.map(play, seeds, lengths)


def session(configs: Path, seed: int, duration_s: float) -> Played:
    """Run one session."""
    variant = variant_of(seed)
    with tempfile.TemporaryDirectory() as folder:
        settings = load(written(variant, configs, Path(folder) / "configs"))
        tally = RandomSession(settings, seed, variant.name, duration_s).run()
    return Played(seed, variant.name, tally)
