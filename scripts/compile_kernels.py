"""Compile the kernels that most tests call, so that no two processes of tests compile the same.

The compiled code is kept on disk (`observer/jit.py`); a second call takes seconds.
"""

import sys
from pathlib import Path

import numpy as np

from analysis.calibration.likelihood import Likelihood
from analysis.calibration.motion import prepare
from analysis.calibration.quantities import frame_of
from analysis.calibration.session import middle_of
from analysis.recording import recording
from analysis.replay import warm_up as warm_up_replay
from daemon.core.modes.persistent_state import PersistentState
from daemon.core.runtime.build import build
from daemon.core.runtime.warm_up import warm_up as warm_up_core
from daemon.preflight.acceptance import check_files
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession

CONFIGS = Path(__file__).parents[1] / "configs"


def main() -> int:
    """Check the shipped files, start a core, walk, replay, and look at a calibration once."""
    for file in (CONFIGS / "demo.toml", CONFIGS / "two_legs.toml"):
        check_files(file)
    settings = load(CONFIGS / "demo.toml")
    warm_up_core(build(settings, "", PersistentState()))
    session = LockstepSession(settings).walk(duration_s=0.1)
    for smooth in (True, False):
        warm_up_replay(settings.robot, smooth=smooth)
    walk = recording("walk.csv", np.array([row[:5] for row in session.truth.rows]))
    motion = prepare([walk], duration_min_s=0.0)
    frame = frame_of(settings.robot, middle_of(motion))
    Likelihood(frame, motion, ~motion.held_out).surprises(frame.free(frame.natural))
    return 0


if __name__ == "__main__":
    sys.exit(main())
