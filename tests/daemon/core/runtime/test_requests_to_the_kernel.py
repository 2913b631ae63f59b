"""What the core asks of kernel and Python, and what it says where it is refused."""

import os
from types import SimpleNamespace

import pytest
from gaitd_names import EventCode

from daemon.core.runtime import realtime
from daemon.ipc.report import Event


class Computer:
    """A computer that refuses what it is told to, and keeps what was asked of it."""

    def __init__(self, monkeypatch, *refused):
        self.refused, self.calls, self.collects = refused, [], True
        asked = self.asked
        libc = SimpleNamespace(mlockall=lambda flags: asked("lock", flags))
        fakes = {
            "os": SimpleNamespace(
                SCHED_FIFO=os.SCHED_FIFO,
                SCHED_RESET_ON_FORK=os.SCHED_RESET_ON_FORK,
                sched_param=lambda priority: priority,
                sched_setscheduler=lambda *one: asked("schedule", *one),
                sched_setaffinity=lambda *one: asked("settle", *one),
                sched_getaffinity=lambda thread: {0: {3, 1}}[thread],
                strerror=os.strerror,
            ),
            "resource": SimpleNamespace(
                RLIMIT_RTPRIO="priority", RLIMIT_MEMLOCK="memory", getrlimit=lambda which: which
            ),
            "ctypes": SimpleNamespace(
                CDLL=lambda name, use_errno: libc if use_errno and name is None else None,
                get_errno=lambda: 12,
            ),
            "gc": SimpleNamespace(
                collect=lambda: asked("collect"),
                freeze=lambda: asked("freeze"),
                disable=lambda: asked("disable"),
                isenabled=lambda: self.collects,
            ),
            "sys": SimpleNamespace(setswitchinterval=lambda one: asked("switch", one)),
        }
        fakes["resource"].getrlimit = lambda which: ({"priority": 20, "memory": 8192}[which], 0)
        for name, fake in fakes.items():
            monkeypatch.setattr(realtime, name, fake)

    def asked(self, name, *values):
        self.calls.append((name, *values))
        for key, error in self.refused:
            if key == name and error is not None:
                raise error
        return -1 if (name, None) in self.refused else 0


TIDY = [("collect",), ("freeze",), ("disable",), ("switch", 1.0)]
LOCK = ("lock", 1 | 2 | 4)  # MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT of mlockall(2)
POLICY = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
SCHEDULE = ("schedule", 0, POLICY, 10)
SETTLE = ("settle", 0, (2, 5))


@pytest.mark.parametrize(
    ("priority", "processors", "calls"),
    [
        (0, (), [LOCK]),
        (1, (), [LOCK, ("schedule", 0, POLICY, 1)]),
        (10, (), [LOCK, SCHEDULE]),
        (0, (2, 5), [LOCK, SETTLE]),
        (10, (2, 5), [LOCK, SETTLE, SCHEDULE]),
    ],
)
def test_it_asks_for_what_the_configuration_says_and_collects_once(
    monkeypatch, priority, processors, calls
):
    computer = Computer(monkeypatch)

    assert realtime.prepare(priority, processors) == []
    assert computer.calls == [*calls, *TIDY]


@pytest.mark.parametrize(
    ("refused", "event"),
    [
        (("lock", None), Event(EventCode.MEMORY_NOT_LOCKED, "", (8192,), os.strerror(12))),
        (("schedule", PermissionError()), Event(EventCode.PRIORITY_REFUSED, "", (10, 20))),
        (("settle", OSError()), Event(EventCode.PROCESSORS_REFUSED, said="1, 3")),
        (("settle", ValueError()), Event(EventCode.PROCESSORS_REFUSED, said="1, 3")),
    ],
)
def test_what_is_refused_is_told_with_its_limit_and_the_rest_is_asked_for(
    monkeypatch, refused, event
):
    computer = Computer(monkeypatch, refused)

    assert realtime.prepare(10, (2, 5)) == [event]
    assert computer.calls == [LOCK, SETTLE, SCHEDULE, *TIDY]


@pytest.mark.parametrize("collects", [True, False])
def test_after_a_bring_up_garbage_is_collected_unless_python_does_it(monkeypatch, collects):
    computer = Computer(monkeypatch)
    computer.collects = collects

    realtime.tidy()

    assert computer.calls == ([] if collects else [("collect",)])
