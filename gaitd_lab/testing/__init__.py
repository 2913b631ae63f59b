"""Test support for this project and for programs around gaitd: a pytest plugin and its parts.

`plugin.py` has the fixtures (docs/integrating.md describes their use) and is the only file that
imports pytest. Its parts: `trainer.py` (virtual drives and service, and requests to them) on
`service.py` (their time and their output; the processes are those of `gaitd_lab/processes.py`);
`vcan.py` (a fresh SocketCAN interface);
`rigs.py` (environments with features that this machine lacks). Nothing of the service imports any
of it.

A test of another program imports this package and nothing else of gaitd: the names of `__all__` are
imported when they are used, because pytest imports this package at each start. Records and messages
have the same `Mode`, `Cause` and `Stage`. Patients who react to the gait are those of
`gaitd_lab/patients.py`.
"""

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from gaitd_names import Cause, Mode, Stage, StopCategory

    from daemon.ipc.record import CycleRecord
    from gaitd_lab.patients import (
        Gait,
        Late,
        Model,
        Patient,
        Slacking,
        Spasm,
        clonic,
        of_ability,
        resisting,
        spastic,
        tiring,
        trembling,
        weak,
    )
    from gaitd_lab.processes import ServiceError
    from gaitd_lab.testing.trainer import VirtualTrainer, virtual_trainer

__all__ = [
    "Cause",
    "CycleRecord",
    "Gait",
    "Late",
    "Mode",
    "Model",
    "Patient",
    "ServiceError",
    "Slacking",
    "Spasm",
    "Stage",
    "StopCategory",
    "VirtualTrainer",
    "clonic",
    "of_ability",
    "resisting",
    "spastic",
    "tiring",
    "trembling",
    "virtual_trainer",
    "weak",
]

_HOME: Final = {
    **dict.fromkeys(("Cause", "CycleRecord", "Mode", "Stage", "StopCategory"), "daemon.ipc.record"),
    **dict.fromkeys(("VirtualTrainer", "virtual_trainer"), "gaitd_lab.testing.trainer"),
    **dict.fromkeys(
        (
            *("Gait", "Late", "Model", "Patient", "Slacking", "Spasm", "clonic", "of_ability"),
            *("resisting", "spastic", "tiring", "trembling", "weak"),
        ),
        "gaitd_lab.patients",
    ),
    "ServiceError": "gaitd_lab.processes",
}
"""Module of each name."""


def __getattr__(name: str) -> object:
    """Import a name of `__all__` when it is used first."""
    if name not in _HOME:
        raise AttributeError(f"gaitd_lab.testing has no {name}; it has {', '.join(__all__)}")
    return getattr(importlib.import_module(_HOME[name]), name)
