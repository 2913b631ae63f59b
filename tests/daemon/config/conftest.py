"""What `gaitd check` sweeps is computed once for each machine, whatever else its files say."""

import pickle

import pytest

from daemon.preflight import runaway_report, stability, workspace

PURE = (
    (workspace, "sweep_ramps"),
    (workspace, "sweep_coasting"),
    (workspace, "drift"),
    (runaway_report, "worst_runaways"),
    (stability, "margin_of"),
)
known = {}


def remembering(function):
    def remembered(*values):
        key = pickle.dumps((function.__name__, values))
        if key not in known:
            known[key] = function(*values)
        return known[key]

    return remembered


@pytest.fixture(scope="module", autouse=True)
def _sweeps_are_remembered():
    with pytest.MonkeyPatch.context() as patch:
        for module, name in PURE:
            patch.setattr(module, name, remembering(getattr(module, name)))
        yield
