"""Compile the kernels that most tests call, so that no two processes of tests compile the same.

The compiled code is kept on disk (`observer/jit.py`); a second call takes seconds.
"""

import sys
from pathlib import Path

from analysis.replay import warm_up as warm_up_replay
from daemon.core.modes.persistent_state import PersistentState
from daemon.core.runtime.build import build
from daemon.core.runtime.warm_up import warm_up as warm_up_core
from daemon.preflight.acceptance import check_files
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession

CONFIGS = Path(__file__).parents[1] / "configs"


def main() -> int:
    """Check the shipped files, start a core, walk, and replay."""
    for file in (CONFIGS / "demo.toml", CONFIGS / "two_legs.toml"):
        check_files(file)
    settings = load(CONFIGS / "demo.toml")
    warm_up_core(build(settings, "", PersistentState()))
    LockstepSession(settings).walk(duration_s=0.1)
    warm_up_replay(settings.robot, smooth=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
