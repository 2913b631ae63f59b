"""What `gaitd check` sweeps is computed once for each machine, whatever else its files say."""

import pickle
from collections.abc import Callable
from functools import wraps
from typing import Any, Final

import pytest

from daemon.config import check_runaway, workspace

PURE: Final = (
    (workspace, "sweep_ramps"),
    (workspace, "sweep_coasting"),
    (workspace, "drift"),
    (check_runaway, "worst_runaways"),
)
known: dict[bytes, Any] = {}


def remembering(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, computed once for the same values."""

    @wraps(function)
    def remembered(*values: Any) -> Any:
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
