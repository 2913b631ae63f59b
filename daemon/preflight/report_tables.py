"""The report of `gaitd check` as tables of text."""

import math
from pathlib import Path
from typing import NamedTuple

from gaitd_texts import Catalogue

from daemon.preflight.axes import AxisMeaning, TorqueMeaning
from daemon.preflight.braking import BrakingMeaning
from daemon.preflight.report import Report, StopMeaning
from daemon.preflight.runaway_report import RunawayMeaning


class Section(NamedTuple):
    """One table of the report: title, column heads, rows of text."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def verdict(config: Path, errors: int, report: Report | None) -> str:
    """One line: whether the service would start with these files, and the number of findings."""
    warnings = "" if report is None else f", {_count(len(report.warnings), 'warning')}"
    if not errors:
        legs = " and one ".join(() if report is None else report.legs)
        return f"{config}: good for one {legs} leg{warnings}"
    unseen = "; the sweeps of motion wait for their correction" if report is None else ""
    return f"{config}: REFUSED, {_count(errors, 'error')}{warnings}{unseen}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def sections(report: Report, texts: Catalogue) -> tuple[Section, ...]:
    """List all tables of the report, in the order of reading."""
    return (
        _axes(report),
        *(_origin(axis) for axis in report.axes),
        _limits(report),
        _stops(report, texts),
        _braking(report),
        _sweeps(report),
        _power(report),
        _runaways(report),
        _loops(report),
        _bus(report),
        _profiles(report),
        Section("SIGTERM", ("what happens",), tuple((line,) for line in report.shutdown)),
        Section("Warnings", ("",), tuple((line,) for line in report.warnings or ("none",))),
        Section("SHA-256", ("file", "hash"), tuple(report.sha256.items())),
    )


def _axes(report: Report) -> Section:
    columns = ("axis", "node", "drive", "one count", "one of 6071h", "one mA", "torque limit")
    rows = tuple(_axis(axis) for axis in report.axes)
    return Section(f"At the joint, with {report.patient} in the machine", columns, rows)


def _axis(axis: AxisMeaning) -> tuple[str, ...]:
    position, effort, scale = _units(axis)
    return (
        axis.name,
        str(axis.node_id),
        axis.drive,
        f"{axis.position_per_count * scale:+.4g} {position}",
        f"{axis.effort_per_permille:+.4g} {effort}",
        f"{axis.effort_per_ma:+.4g} {effort}",
        f"{axis.effort_limit_si:g} {effort} of {axis.effort_drive_limit_si:.1f} "
        f"({axis.effort_nominal_si:.1f} for long)",
    )


def _units(axis: AxisMeaning) -> tuple[str, str, float]:
    """Units of position and effort at this joint, and the factor of the position from SI."""
    return ("deg", "N m", 180.0 / math.pi) if axis.rotary else ("mm", "N", 1e3)


def _origin(axis: AxisMeaning) -> Section:
    """Table of the drive objects behind an axis's numbers, and of the drive's own reactions."""
    _, effort, _ = _units(axis)
    limit = f"{axis.torque_limit_raw} in {_torque(axis.torque_limit, effort)}"
    rows = [
        ("drive", f"{axis.drive}, {_verified(axis)}"),
        ("torque is read from", f"{_torque(axis.torque_source, effort)}; {_path(axis)}"),
        ("torque is commanded by", _torque(axis.target_torque, effort)),
        ("torque is limited by", limit),
        *(
            ("must hold, within 1 %", f"{base.object} = {base.expected_raw}, {base.what}")
            for base in axis.torque_bases
        ),
        *(("by itself", words) for words in axis.option_codes),
        ("notices silence", _silence(axis)),
        ("temperature", axis.temperature or "cannot be read: its limit is not watched"),
    ]
    return Section(f"Where the numbers of {axis.name} come from", ("", ""), tuple(rows))


def _profiles(report: Report) -> Section:
    axes = {axis.drive: axis for axis in report.axes}
    rows: list[tuple[str, ...]] = []
    for drive, axis in axes.items():
        rows.append((drive, _verified(axis)))
        rows += [("", source) for source in axis.sources]
        if axis.open_facts:
            rows.append(("", f"no public document states {', '.join(axis.open_facts)}"))
    return Section("Where the drives' facts come from", ("drive", "sources"), tuple(rows))


def _verified(axis: AxisMeaning) -> str:
    return "verified on hardware" if axis.verified_on_hardware else "NOT verified on hardware"


def _torque(torque: TorqueMeaning, effort: str) -> str:
    kind = f"{'signed' if torque.signed else 'unsigned'} {torque.bits} bits"
    factor = "" if torque.factor == 1 else f" times {torque.factor:.6g}"
    count = f"one is {torque.effort_per_count_si:.4g} {effort}"
    unit = torque.unit.replace("_", " ")
    return f"{torque.object}, {kind}, {unit}{factor}, by {torque.base}: {count}"


def _path(axis: AxisMeaning) -> str:
    """Factors from the drive's torque to the joint: gear, lead, signs, sampling."""
    lead = "" if axis.lead_m is None else f", lead {axis.lead_m * 1e3:g} mm"
    signs = f"sign {axis.torque_sign:+d} in the drive, {axis.axis_sign:+d} of the axis"
    return f"gear {axis.gear_ratio:g}{lead}, {signs}, sampling: {axis.torque_sampling}"


def _silence(axis: AxisMeaning) -> str:
    watches = (
        (axis.heartbeat_detection_ms, "without our heartbeat (1016h:01)"),
        (axis.rpdo_timeout_ms, "without RPDO1 (1400h:05)"),
    )
    return ", ".join(f"after {ms} ms {what}" for ms, what in watches if ms is not None)


def _limits(report: Report) -> Section:
    columns = ("axis", "position", "counts", "speed", "raw", "torque raw", "quick stop", "silence")
    rows = tuple(_limits_of(axis) for axis in report.axes)
    return Section("Written into the drives", columns, rows)


def _limits_of(axis: AxisMeaning) -> tuple[str, ...]:
    unit, _, scale = _units(axis)
    low, high = axis.position_limits_si
    low_counts, high_counts = axis.position_limits_counts
    return (
        axis.name,
        f"{low * scale:g} to {high * scale:g} {unit}",
        f"{low_counts} to {high_counts}",
        f"{axis.speed_limit_si_per_s * scale:.0f} {unit}/s",
        "not written" if axis.speed_limit_raw is None else str(axis.speed_limit_raw),
        str(axis.torque_limit_raw),
        f"{axis.quick_stop_s:.2f} s, then {'brake' if axis.brake else 'held'}",
        f"{axis.silence_detection_ms} ms",
    )


def _stops(report: Report, texts: Catalogue) -> Section:
    rows = tuple(_stop_cells(stop, texts.text(f"stopped.{stop.cause}")) for stop in report.stops)
    return Section("How it stops for what", ("", "what", "cause", "chosen by"), rows)


def _stop_cells(stop: StopMeaning, title: str) -> tuple[str, ...]:
    return stop.category, title, stop.cause, "design" if stop.fixed else "limits file"


def _braking(report: Report) -> Section:
    columns = ("axis", "quick-stop ramp", "asks at most", "at", "torque limit", "allows", "")
    rows = tuple(_brakes(axis) for axis in report.braking)
    return Section("Torque of a quick stop, without the help of friction", columns, rows)


def _brakes(axis: BrakingMeaning) -> tuple[str, ...]:
    effort, ramp = ("N m", "rad/s^2") if axis.rotary else ("N", "m/s^2")
    return (
        axis.name,
        f"{axis.deceleration_si_per_s2:g} {ramp}",
        f"{axis.required_si:.1f} {effort}, {axis.patient_si:g} for the patient",
        f"hip {axis.hip_deg:.1f} deg, slide {axis.slide_m:.3f} m",
        f"{axis.limit_si:.1f} {effort}",
        f"{max(axis.deceleration_max_si_per_s2, 0.0):.2f} {ramp}",
        "given" if axis.is_given else "CANNOT BE GIVEN",
    )


def _sweeps(report: Report) -> Section:
    columns = ("stop at the highest cadence", "hip", "slide", "least |sin|", "ends", "")
    rows = tuple(
        (
            sweep.kind,
            f"{sweep.hip_deg[0]:.1f} to {sweep.hip_deg[1]:.1f} deg",
            f"{sweep.slide_m[0]:.3f} to {sweep.slide_m[1]:.3f} m",
            f"{sweep.least_singularity_ratio:.2f}",
            _end(sweep.hip_end_speed_rad_per_s, sweep.slide_end_speed_m_per_s),
            "inside" if sweep.stays_inside else "LEAVES THE WORKSPACE",
        )
        for sweep in report.sweeps
    )
    return Section("Workspace, swept over a stride", columns, rows)


def _end(hip_rad_per_s: float, slide_m_per_s: float) -> str:
    if hip_rad_per_s:
        return f"hip at {hip_rad_per_s:.1f} rad/s"
    return f"slide at {slide_m_per_s:.1f} m/s" if slide_m_per_s else "at rest"


def _power(report: Report) -> Section:
    drift = report.drift
    rows = (
        (
            "hip",
            f"{drift.hip_moved_deg:.1f} deg ({drift.hip_from_deg:.1f} to {drift.hip_to_deg:.1f})",
            f"{drift.hip_speed_rad_per_s:.2f} rad/s",
        ),
        (
            "slide",
            f"{drift.slide_moved_m:.3f} m ({drift.slide_from_m:.3f} to {drift.slide_to_m:.3f})",
            f"{drift.slide_speed_m_per_s:.2f} m/s",
        ),
    )
    columns = ("axis", "moves at most", "as fast as")
    return Section("Without power, from rest at any pose of the gait", columns, rows)


def _runaways(report: Report) -> Section:
    columns = ("axis", "goes at most", "of it unnoticed", "as fast as", "max_runaway", "")
    rows = tuple(_runaway(axis) for axis in report.runaways)
    title = "If the core dies at full torque, until the drives have stopped by themselves"
    return Section(title, columns, rows)


def _runaway(axis: RunawayMeaning) -> tuple[str, ...]:
    scale, unit = (180.0 / math.pi, "deg") if axis.rotary else (1.0, "m")
    digits = 1 if axis.rotary else 3
    end = "TOO FAR" if axis.is_too_far else "allowed"
    return (
        axis.name,
        f"{axis.distance_si * scale:.{digits}f} {unit}, from {axis.from_si * scale:.{digits}f}",
        f"{axis.until_noticed_si * scale:.{digits}f} {unit} in {axis.detection_ms} ms",
        f"{axis.speed_max_si:.2f} {'rad' if axis.rotary else 'm'}/s"
        + ("" if axis.keeps_speed else ", no speed limit of its own"),
        f"{axis.max_runaway_si * scale:g} {unit}",
        f"{end}, ends with the leg stretched" if axis.ends_stretched else end,
    )


def _loops(report: Report) -> Section:
    columns = ("loop", "margin", "least for", "at")
    rows = tuple(
        (
            loop.loop,
            f"{loop.margin_ratio:.2f}" if loop.is_stable else f"{loop.margin_ratio:.2f}, SHAKES",
            f"the leg {loop.leg}, {loop.key}",
            f"hip {loop.hip_deg:.0f} deg, slide {loop.slide_m:.2f} m",
        )
        for loop in report.loops
    )
    title = "Loops over the bus: how many times lighter the leg may be before one shakes"
    return Section(title, columns, rows)


def _bus(report: Report) -> Section:
    bus = report.bus
    rows = (
        ("interface", f"{bus.interface} {bus.channel}, {bus.bitrate_bit_per_s} bit/s"),
        ("real drives", ", ".join(bus.real_drives) or "none"),
        ("drives of gaitd sim", ", ".join(bus.virtual_drives) or "none"),
        ("load at worst", f"{bus.load_ratio:.1%}, allowed {bus.load_max_ratio:.0%}"),
        ("frames of a cycle", f"{bus.burst_ms:.2f} ms, the window is {bus.window_ms:g} ms"),
    )
    return Section("Bus", ("", ""), rows)
