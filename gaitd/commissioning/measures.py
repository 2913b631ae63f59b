"""What a step of the procedure has shown: findings from its records and events, once it is over."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from gaitd_names import EventCode, Mode, MotionPhase, Stage
from msgspec.structs import replace

from analysis.acceptance.record import (
    Finding,
    FindingCode,
    Judgement,
    Reason,
    ReasonCode,
    Section,
    StopTrace,
)
from daemon.ipc.record import DriveRecord
from gaitd.commissioning.messages import PASSED_OR_FAILED
from gaitd.commissioning.procedure import Scene, not_measured
from gaitd.commissioning.stops import StopRules, WayToStop, drive_of, judge, measure

if TYPE_CHECKING:  # importing the core takes a second, and most commands do not need it
    from daemon.core.state import Axis

UNIT_TOLERANCE_RATIO: Final = 0.05
"""Tolerance of a motion that a person has measured with a ruler or a protractor."""
BOUND_RATIO: Final = 0.98
"""A command of this share of its bound has reached it."""
ENDS: Final[Mapping[str, Judgement]] = {
    EventCode.SIGN_TESTED: Judgement.PASSED,
    EventCode.HOMED: Judgement.PASSED,
    EventCode.SELF_TEST_PASSED: Judgement.PASSED,
    EventCode.SELF_TEST_FAILED: Judgement.FAILED,
    EventCode.SINGLE_AXIS_FAILED: Judgement.FAILED,
}
"""Events that report the end of a sign test, a homing and a self-test."""


def distance_unit(axis: str) -> tuple[str, float]:
    """Unit in which a person measures the motion of an axis, and its size in SI units."""
    return {"hip": ("degrees", math.radians(1)), "slide": ("mm", 1e-3)}[axis.rpartition("/")[2]]


# --- one axis -------------------------------------------------------------------------------------


def sign_findings(scene: Scene, axis: "Axis") -> Iterator[Finding]:
    """Motion along the torque, measured against commanded torque, and the service's judgement."""
    records = [one for one in scene.records if one.mode is Mode.COMMISSION]
    drives = [drive_of(record, axis.name) for record in records if record.stage is Stage.PLAYING]
    yield _pushed(scene, MotionPhase.FORTH, drives, axis)
    yield _pushed(scene, MotionPhase.BACK, drives, axis)
    yield _effort(scene, drives, axis)
    yield _bound(scene, drives, axis)
    yield from own_findings(scene)


def own_findings(scene: Scene) -> Iterator[Finding]:
    """What the service says about a sign test or a homing."""
    code, axis = FindingCode.OWN_JUDGEMENT, scene.task.axis
    ended = [one for one in scene.state.reports if one.subject == axis and one.code in ENDS]
    if ended:
        yield replace(scene.found(code, ENDS[ended[-1].code]), report=ended[-1])
    else:
        yield scene.found(code, Judgement.FAILED, why=ReasonCode.NO_RESULT)


def _pushed(
    scene: Scene, phase: MotionPhase, drives: Sequence[DriveRecord], axis: "Axis"
) -> Finding:
    """One push: the joint must not move against its torque."""
    code, along = FindingCode.PUSHED, 1.0 if phase is MotionPhase.FORTH else -1.0
    pushed = [drive for drive in drives if drive.target_effort * along > 0]
    known = [drive.position for drive in pushed if drive.position is not None]
    moved_si = known[-1] - known[0] if known else 0.0
    effort_si = max((drive.target_effort * along for drive in pushed), default=0.0) * along
    least_si = 0.5 * axis.push.motion_si
    values = {"effort_si": effort_si, "moved_si": moved_si, "least_si": least_si}
    values |= {"phase": phase}
    if abs(moved_si) < least_si:
        return scene.found(code, Judgement.NOT_MEASURED, values, ReasonCode.NOT_MOVED)
    return scene.found(code, PASSED_OR_FAILED[moved_si * along > 0], values)


def _effort(scene: Scene, drives: Sequence[DriveRecord], axis: "Axis") -> Finding:
    """The measured torque against the commanded one, in value and sign."""
    code = FindingCode.EFFORT
    largest_si = max((abs(drive.target_effort) for drive in drives), default=0.0)
    pairs = [
        (drive.target_effort, drive.effort)
        for drive in drives
        if drive.effort is not None and abs(drive.target_effort) > 0.5 * largest_si
    ]
    limit_si = axis.limits.effort_deviation_max_si
    values = {"limit_si": limit_si}
    if not pairs:
        return scene.found(code, Judgement.NOT_MEASURED, values, ReasonCode.NO_SAMPLE)
    apart_si = sum(abs(effort - target) for target, effort in pairs) / len(pairs)
    along_si = sum(math.copysign(effort, effort * target) for target, effort in pairs) / len(pairs)
    same = sum(effort * target for target, effort in pairs) > 0
    values |= {"apart_si": apart_si, "along_si": along_si}
    return scene.found(code, PASSED_OR_FAILED[same and apart_si <= limit_si], values)


def _bound(scene: Scene, drives: Sequence[DriveRecord], axis: "Axis") -> Finding:
    """The bound of the sign test, which is also the drive's limit while it lasts.

    Most axes move before they reach it: then nothing has shown it to act.
    """
    limit_si, noise_si = axis.push.effort_max_si, axis.limits.effort_deviation_max_si
    wanted_si = max((abs(drive.target_effort) for drive in drives), default=0.0)
    largest_si = max((abs(drive.effort or 0.0) for drive in drives), default=0.0)
    values = {"largest_si": largest_si, "limit_si": limit_si, "noise_si": noise_si}
    values |= {"wanted_si": wanted_si}
    judged = PASSED_OR_FAILED[largest_si <= limit_si + noise_si]
    if judged is Judgement.PASSED and wanted_si < BOUND_RATIO * limit_si:
        judged = Judgement.NOT_MEASURED
    return replace(scene.found(FindingCode.BOUND, judged, values), section=Section.LIMITS)


def unit_findings(scene: Scene, axis: "Axis") -> Iterator[Finding]:
    """The encoder's motion between two marks, beside the distance that the operator measured."""
    unit, size_si = distance_unit(axis.name)
    first_si, second_si = scene.state.marks_si
    moved_si, wanted_si = abs(second_si - first_si), abs(scene.state.distance_si)
    ratio = moved_si / wanted_si
    counts_per_si = abs(axis.scaling.counts_per_si)
    values = {
        "distance": wanted_si / size_si,
        "distance_unit": unit,
        "moved_si": moved_si,
        "count": moved_si * counts_per_si,
        "counts_per_si": counts_per_si,
        "ratio": ratio,
        "wanted_si": wanted_si,
        "tolerance_ratio": UNIT_TOLERANCE_RATIO,
    }
    judged = PASSED_OR_FAILED[abs(ratio - 1) <= UNIT_TOLERANCE_RATIO]
    yield scene.found(FindingCode.UNITS, judged, values)


def position_findings(scene: Scene) -> Iterator[Finding]:
    """Whether the position of an axis is valid now."""
    newest = scene.newest
    valid = newest is not None and drive_of(newest, scene.task.axis).referenced
    why = None if valid else ReasonCode.NO_RESULT
    yield scene.found(FindingCode.REFERENCED, PASSED_OR_FAILED[valid], why=why)


# --- all axes -------------------------------------------------------------------------------------


def self_test_findings(scene: Scene) -> Iterator[Finding]:
    """The results of a self-test; of the axes that have one, if the task names none."""
    tests = {EventCode.SELF_TEST_PASSED, EventCode.SELF_TEST_FAILED}
    results = {one.subject: one for one in scene.state.reports if one.code in tests}
    code, section = FindingCode.LOAD, Section.SELF_TEST
    for finding in scene.task.missing or not_measured(results, section, code):
        mine = results.get(finding.drive)
        if mine is None:
            why = Reason(ReasonCode.NO_RESULT, finding.drive, service=scene.seen.service)
            yield replace(finding, reason=why)
        else:
            yield replace(finding, judgement=ENDS[mine.code], report=mine)


def stop_findings(
    scene: Scene, way: WayToStop, rules: Sequence[StopRules]
) -> Iterator[Finding | StopTrace]:
    """A stop of each of these axes, and that it was the stop which was asked for."""
    for allowed in rules:
        acts = stop_acts(allowed.axis, way)
        stop = measure(scene.records, allowed)
        if stop is None:
            reason = Reason(ReasonCode.NO_STOP, allowed.axis)
            yield replace(acts, judgement=Judgement.FAILED, reason=reason)
            continue
        yield from judge(stop, way, allowed)
        yield stop
        values = {**acts.values, "category": stop.category, "cause": stop.cause}
        judged = PASSED_OR_FAILED[stop.cause == way.cause]
        yield replace(acts, judgement=judged, values=values)


def stop_acts(axis: str, way: WayToStop) -> Finding:
    """The finding that this way of stopping acts, before it is measured."""
    values = {"cause_wanted": str(way.cause)}
    code, judged = FindingCode.STOP_ACTS, Judgement.NOT_MEASURED
    return Finding(axis, Section.LIMITS, code, judged, values)
