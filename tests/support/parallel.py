"""Who runs what, when the tests run on several processors (`pytest -n auto`, pytest-xdist).

A file is run by one worker, in its order, so its module fixtures are made once. The files of LONG
are handed out test by test. What runs real processes, or shows how long something took, is ALONE:
all of it by one worker, and not before every other one has nothing more to do.
"""

from typing import Final

from xdist.scheduler import LoadScopeScheduling
from xdist.workermanage import WorkerController

ALONE: Final = (
    "tests/service/",
    "tests/rigs/",
    "tests/conformance/test_canopen_",
    "tests/conformance/test_durand_",
    "tests/daemon/gateway/test_over_zenoh.py",
    "tests/daemon/gateway/test_process.py",
    "tests/daemon/gateway/test_setpoints.py",
    "tests/daemon/gateway/test_supervised.py",
    "tests/drives/test_bus.py",
    "tests/gaitd/test_bench.py",
    "tests/gaitd/test_bench_peers.py",
    "tests/gaitd/test_demo.py",
    "tests/gaitd/test_demonstration_parts.py",
    "tests/gaitd/test_doctor.py",
    "tests/gaitd/test_drive_command.py",
    "tests/gaitd/test_scan_other_stacks.py",
    "tests/gaitd/test_sim.py",
    "tests/gaitd/testing/test_plugin.py",
    "tests/observer/test_benchmarks.py",
    "tests/sim_drives/test_realtime.py",
    "tests/test_held_up.py",
)
"""Beginnings of what pytest calls a test."""
LONG: Final = ("tests/faults/test_fault_matrix.py", "tests/closed_loop/test_faults.py")
"""Files of many tests that share no fixture and take long."""
LAST: Final = "alone"


def scope_of(nodeid: str) -> str:
    """What is run by one worker in one go."""
    if nodeid.startswith(ALONE):
        return LAST
    return nodeid if nodeid.startswith(LONG) else nodeid.partition("::")[0]


class AloneLast(LoadScopeScheduling):
    """As pytest-xdist's `loadscope`, but one scope begins when all others have ended."""

    def _split_scope(self, nodeid: str) -> str:
        return scope_of(nodeid)

    def _assign_work_unit(self, node: WorkerController) -> None:
        if LAST in self.workqueue:
            self.workqueue.move_to_end(LAST)
        if not self._only_the_last_is_left() or self._others_are_done(node):
            super()._assign_work_unit(node)

    def _reschedule(self, node: WorkerController) -> None:
        if not self._only_the_last_is_left():
            super()._reschedule(node)
            return
        # A worker that may get more holds its last test back; who gets no more is told so.
        running = [one for one in self.nodes if not one.shutting_down]
        for one in running[1:]:
            one.shutdown()
        for one in running[:1]:
            self._assign_work_unit(one)

    def _only_the_last_is_left(self) -> bool:
        return list(self.workqueue) == [LAST]

    def _others_are_done(self, node: WorkerController) -> bool:
        others = (work for one, work in self.assigned_work.items() if one is not node)
        return not any(self._pending_of(work) for work in others)
