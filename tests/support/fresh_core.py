"""Cores before bring-up: one is built, and each test changes a copy, which costs far less."""

from copy import deepcopy
from dataclasses import replace
from typing import Any

import msgspec
from sessions import demo

from daemon.core.modes.persistent_state import PersistentState
from daemon.core.runtime.build import Built, build
from daemon.core.state import Axis, Core

_BUILT = build(demo(), "test", PersistentState())


def fresh(persistent: PersistentState = _BUILT.core.persistent) -> Built:
    """A core of the demonstration in mode OFF, and the plans for its bring-up."""
    core = deepcopy(_BUILT.core)
    core.persistent = persistent
    return replace(_BUILT, core=core)


def has_been_sent(axis: Axis, **changes: Any) -> None:
    """Make the last command to an axis another one: fields of its `Sent`."""
    axis.sent = msgspec.structs.replace(axis.sent, **changes)


def has_received(core: Core, **changes: Any) -> None:
    """Make the core have received something else from its gateway: fields of its `Inputs`."""
    core.inputs = msgspec.structs.replace(core.inputs, **changes)


def show(axis: Axis, **changes: Any) -> None:
    """Make an axis show something else than before: fields of its `Sensed`."""
    axis.sensed = msgspec.structs.replace(axis.sensed, **changes)
