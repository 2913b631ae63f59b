"""A drive profile proposed from a maker's EDS alone, for `gaitd drive profile`.

Rules:
1.  An object's existence, width, access, right to be mapped and constants are the file's. What
    CiA 402 defines is taken from there. What neither tells is the choice that is refused or found
    out soonest, in `must_show`, with a question.
2.  A meaning is never guessed from a name. Maker's objects whose names fit are candidates of a
    question; one is chosen only where there would be no torque limit, no base or an empty TPDO3.
3.  What keeps the service from using the drive is said in the words of `gaitd check`: the proposal
    is held against the same file, with a motor and limits that only serve for this.
"""

import re
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import msgspec

from drives.bringup.plan import CycleSettings, plan
from drives.canopen.data_sheet import DataSheet, Variable
from drives.canopen.objects import Object
from drives.cia402.axis_file import AxisFile
from drives.cia402.profile import DriveDescription, DriveProfile, contradictions
from drives.cia402.sources import facts
from drives.cia402.units import DriveLimits
from drives.service.eds import objections

CIA: Final = "CiA 402-2"
_TORQUE_ACTUAL: Final = 0x6077
_CURRENT_ACTUAL: Final = 0x6078
_RATED_CURRENT: Final = 0x6075
_RATED_TORQUE: Final = 0x6076
_TORQUE_MAX: Final = 0x6072
_CURRENT_MAX: Final = 0x6073
_POSITION_UNIT: Final = 0x60A8
_SPEED_UNIT: Final = 0x60A9
_GEAR_RATIO: Final = 0x6091
_RPM: Final = 0x00B44700
_PDOS_MIN, _PDOS_MAX = 3, 8
_CODES: Final = {
    Object.QUICK_STOP: ((6, 5, 7, 8, 2, 1, 3, 4), "quick stop on its ramp"),
    Object.FAULT_REACTION: ((2, 1, 3, 4), "a fault brakes before it switches off"),
    Object.ABORT_CONNECTION: ((3, 1, 2), "without its master the drive stops by itself"),
    Object.HALT: ((2, 1, 3, 4), "a halt brakes and stays enabled"),
    Object.SHUTDOWN: ((1, 0), "an unrequested shutdown slows down before it switches off"),
    Object.DISABLE: ((1, 0), "disabling the operation slows down before it switches off"),
}
"""Option codes: values by preference, and what they are for."""
_OPTIONAL: Final = {
    "interpolation_time": ((Object.INTERPOLATION_TIME, 1, 8), (Object.INTERPOLATION_TIME, 2, 8)),
    "position_limits": ((Object.POSITION_LIMITS, 1, 32), (Object.POSITION_LIMITS, 2, 32)),
    "speed_limit": ((Object.SPEED_LIMIT, 0, 32),),
    "following_error": ((Object.FOLLOWING_WINDOW, 0, 32),),
    "halt_option": ((Object.HALT, 0, 16),),
    "sync_counter": ((Object.SYNC_COUNTER, 0, 8),),
    "sync_window": ((Object.SYNC_WINDOW, 0, 32),),
}
"""Key of `[optional_objects]`: index, sub-index and width of what it writes."""
_JUDGED_BY_THE_MACHINE: Final = tuple(
    f"{index:04X}h"
    for index in (_TORQUE_MAX, 0x607D, 0x6080, 0x6065, Object.QUICK_STOP_DECELERATION)
)
_LIMITS: Final = DriveLimits(-1.0, 1.0, 1.0, 10.0, 0.2, 20.0)
_CYCLE: Final = CycleSettings(10, 1, 20, 100, 30)
_MOTOR: Final = {"torque_constant_nm_per_a": 0.1, "nominal_current_a": 5.0, "current_limit_a": 10.0}
_MOTOR_RAW: Final = {"rated_current": 5000, "torque_constant": 100_000}
_RATED_RAW: Final = {"milli_newton_metre": 500, "micro_newton_metre": 500_000}

Toml = bool | int | float | str | list[int] | dict[str, int | bool]


class Told(NamedTuple):
    """One value of the profile, and where it is from."""

    value: Toml
    source: str
    """A section of the EDS, or the standard."""
    question: str = ""
    """What the drive or its manual must say; empty where the source states the value."""


class Proposal(NamedTuple):
    """A profile, what keeps the drive from being used, and what must be found out."""

    vendor: str
    family: str
    tables: dict[str, dict[str, Told]]
    """By the name of the table, `""` for the keys above all tables."""
    lists: dict[str, list[dict[str, Told]]]
    """`written` and `checked`."""
    notes: tuple[str, ...]
    """Questions that belong to no key."""
    obstacles: tuple[str, ...]
    identity: dict[str, int | None]
    """Values of 1018h in the file, by the key of an axis file."""

    @property
    def questions(self) -> tuple[str, ...]:
        """What must be found out, each with its key."""
        return (*(f"{key}: {told.question}" for key, told in _open(self)), *self.notes)


def propose(sheet: DataSheet, file: str, node_id: int) -> Proposal:
    """Propose a profile.

    Args:
        sheet: objects of the EDS.
        file: its name, for the sources.
        node_id: of the drive.
    """
    tables: dict[str, dict[str, Told]] = {"": {}}
    tables |= _torque(sheet)
    tables["optional_objects"] = _optional(sheet)
    tables |= _temperature(sheet)
    unknown = Told("unknown", file, "does the drive keep it in cyclic synchronous torque?")
    tables["torque_mode"] = {"speed_limit": unknown, "position_limits": unknown}
    tables["pdo"] = _pdo(sheet)
    entries = sum(1 for index, sub in sheet.variables if index == 0x1016 and sub)
    tables["heartbeat"] = {"consumer_entries": Told(entries, f"[1016], {entries} members")}
    written, checked = list(_written(sheet)), list(_checked(sheet))
    tables[""] = _top(sheet, file, written)
    identity: dict[str, int | None] = {}
    for sub, key in enumerate(("vendor_id", "product_code", "revision", "serial"), 1):
        one = sheet.get(Object.IDENTITY, sub)
        held = None if one is None else one.value if one.value is not None else one.default
        identity[key] = held if isinstance(held, int) and held else None
    numbers = [sheet.device_number(key) for key in ("VendorNumber", "ProductNumber")]
    for key, number in zip(("vendor_id", "product_code"), numbers, strict=True):
        identity[key] = identity[key] or number
    found = Proposal(
        vendor=_printable(sheet.device.get("vendorname", "")) or "unnamed vendor",
        family=_printable(sheet.device.get("productname", "")) or "unnamed product",
        tables=tables,
        lists={"written": written, "checked": checked},
        notes=tuple(_notes(sheet, identity)),
        obstacles=(),
        identity=identity,
    )
    return found._replace(obstacles=tuple(_obstacles(found, sheet, file, node_id)))


def profile_table(proposal: Proposal, file: str) -> dict[str, object]:
    """The proposal as the tables of a profile file."""
    plain: dict[str, object] = {
        "vendor": proposal.vendor,
        "family": proposal.family,
        "verified_on_hardware": False,
    }
    for name, table in proposal.tables.items():
        values = {key: told.value for key, told in table.items()}
        if name:
            plain[name] = values
        else:
            plain |= values
    for name, rows in proposal.lists.items():
        plain[name] = [{key: told.value for key, told in row.items()} for row in rows]
    must_show = list(dict.fromkeys(key for key, _ in _open(proposal)))
    every = facts(msgspec.convert({**plain, "sources": []}, DriveProfile, strict=False))
    stated = {fact.partition(".")[0] for fact in every if fact not in must_show}
    what = f"the EDS '{file}' of {proposal.vendor} {proposal.family}, and {CIA} for meanings"
    plain |= {"must_show": must_show, "sources": [{"what": what, "states": sorted(stated)}]}
    return plain


def _open(proposal: Proposal) -> Iterator[tuple[str, Told]]:
    """Keys with a question, as `must_show` names them."""
    for name, table in proposal.tables.items():
        for key, told in table.items():
            if told.question:
                yield (f"{name}.{key}" if name else key), told
    for name, rows in proposal.lists.items():
        for row in rows:
            place = f"{row['index'].value:04X}h:{row['sub'].value:02X}"
            for told in row.values():
                if told.question:
                    yield f"{name}.{place}", told


# --- parts of the profile -----------------------------------------------------------------------


def _section(variable: Variable) -> str:
    """`[6077] i16 ro, can be mapped`."""
    name = f"[{variable.index:04X}" + (f"sub{variable.sub:X}]" if variable.parent else "]")
    kind = f"{'i' if variable.signed else 'u'}{variable.bits}"
    mapped = ", can be mapped" if variable.mappable else ""
    return f"{name} {kind} {variable.access}{mapped}"


def _at(
    sheet: DataSheet, index: int, sub: int = 0, *, mapped: bool = False, written: bool = False
) -> Variable | None:
    """The integer at a place that has these rights."""
    one = sheet.get(index, sub)
    usable = one is not None and one.is_integer and one.bits <= 32
    if one is None or not usable or (mapped and not one.mappable) or (written and not one.writable):
        return None
    return one


def _named(sheet: DataSheet, pattern: str, *, written: bool = False) -> list[Variable]:
    """Integers of the maker whose names fit."""
    return [
        one
        for one in sheet.variables.values()
        if 0x2000 <= one.index < 0x6000
        and re.search(pattern, one.qualified_name, re.IGNORECASE)
        and one.is_integer
        and one.bits in (8, 16, 32)
        and (one.writable or not written)
    ]


def _listed(variables: Iterable[Variable]) -> str:
    return ", ".join(f"{one.place} '{_printable(one.qualified_name)}'" for one in variables)


def _ref(variable: Variable) -> dict[str, int | bool]:
    index, sub = variable.address
    return {"index": index, "sub": sub, "bits": variable.bits, "signed": variable.signed}


def _torque(sheet: DataSheet) -> dict[str, dict[str, Told]]:
    """Source, base, limit and target."""
    rated_torque, rated_current = _at(sheet, _RATED_TORQUE), _at(sheet, _RATED_CURRENT)
    base: dict[str, Told] = {}
    if rated_torque is not None:
        ask = "is it in mN m, as CiA 402 says, or in uN m (a factor of 1000)?"
        base["rated_torque_unit"] = Told("milli_newton_metre", CIA, ask)
        base["rated_torque"] = Told(_ref(rated_torque), _section(rated_torque))
    if rated_current is not None:
        base["rated_current"] = Told(_ref(rated_current), f"{_section(rated_current)}: mA by {CIA}")
    elif rated_torque is None:
        for one in _named(sheet, r"(rated|nominal).{0,8}current")[:1]:
            ask = f"is {_listed([one])} the current of 1000 per mille, in mA?"
            base["rated_current"] = Told(_ref(one), f"{_section(one)}, by its name", ask)
    unit = f"permille_of_rated_{'current' if rated_torque is None else 'torque'}"
    meaning = f"{unit.replace('_', ' ')} by {CIA}"
    is_current = _at(sheet, _TORQUE_ACTUAL, mapped=True) is None and rated_current is not None
    actual = _CURRENT_ACTUAL if is_current else _TORQUE_ACTUAL
    source = sheet.get(actual) or Variable(actual, 0, data_type=3)
    others = [
        one
        for one in _named(sheet, r"(torque|current).{0,12}(actual|averaged|filtered|value)")
        if one.mappable and not one.writable
    ]
    ask = "what is it filtered with, and when is it sampled?"
    if others:
        ask += f" Others that could be the source: {_listed(others[:6])}"
    source_unit = "permille_of_rated_current" if is_current else unit
    return {
        "torque_source": {
            **_torque_object(source, Told(source_unit, meaning)),
            "sign": Told(1, CIA, "is it positive where 6064h grows?"),
            "sampling": Told("unknown", "the EDS cannot tell", ask),
        },
        "torque_base": base,
        "torque_limit": _torque_limit(sheet, unit, meaning),
        "target_torque": _torque_object(
            sheet.get(Object.TARGET_TORQUE) or Variable(Object.TARGET_TORQUE, 0, data_type=3),
            Told(unit, meaning),
        ),
    }


def _torque_limit(sheet: DataSheet, unit: str, meaning: str) -> dict[str, Told]:
    for index, limited in ((_TORQUE_MAX, unit), (_CURRENT_MAX, "permille_of_rated_current")):
        one = _at(sheet, index, written=True)
        if one is not None:
            more = _at(sheet, _CURRENT_MAX, written=True)
            ask = "" if more in (None, one) else "does the smaller of 6072h and 6073h count?"
            return _torque_object(one, Told(limited, meaning, ask))
    names = r"(output|max\w*|peak).{0,8}(current|torque)|(current|torque).{0,8}(limit|max)"
    for one in _named(sheet, names, written=True)[:1]:
        by_name = "milliampere" if one.bits == 32 else "permille_of_rated_current"
        ask = f"there is no 6072h and no 6073h: is {_listed([one])} the limit, and in which unit?"
        return _torque_object(one, Told(by_name, "by its name", ask))
    return _torque_object(Variable(_TORQUE_MAX, 0, data_type=6), Told(unit, meaning))


def _torque_object(variable: Variable, unit: Told) -> dict[str, Told]:
    place = {key: Told(value, _section(variable)) for key, value in _ref(variable).items()}
    if variable.bits not in (8, 16, 32):
        place["bits"] = Told(16, CIA)
    return {**place, "unit": unit, "factor": Told(1.0, unit.source)}


def _optional(sheet: DataSheet) -> dict[str, Told]:
    found: dict[str, Told] = {}
    for key, places in _OPTIONAL.items():
        parts = [_at(sheet, index, sub, written=True) for index, sub, _ in places]
        fits = [
            part is not None and part.bits == bits
            for part, (*_, bits) in zip(parts, places, strict=True)
        ]
        place = f"{places[0][0]:04X}h"
        source = _section(parts[0]) if parts[0] is not None else f"no {place} that can be written"
        found[key] = Told(all(fits), source)
    polarity = sheet.get(Object.POLARITY)
    there = polarity is not None
    found["polarity"] = Told(there, _section(polarity) if polarity is not None else "no 607Eh")
    return found


def _pdo(sheet: DataSheet) -> dict[str, Told]:
    counts = [
        next((n for n in range(512) if sheet.get(first + n, 1) is None), 512)
        for first in (Object.RPDO, Object.TPDO)
    ]
    count = min(max(min(counts), _PDOS_MIN), _PDOS_MAX)
    ask = ""
    if max(counts) > count:
        ask = f"{counts[0]} RPDOs and {counts[1]} TPDOs: are those above {count} off by default?"
    timeout = _at(sheet, Object.RPDO, 5, written=True)
    code = sheet.get(Object.ERROR_CODE)
    return {
        "count": Told(count, f"[1400] to [{Object.RPDO + counts[0] - 1:04X}], as TPDOs", ask),
        "rpdo_timeout": Told(
            timeout is not None and timeout.bits == 16,
            "no 1400h:05 that can be written" if timeout is None else _section(timeout),
        ),
        "error_code": Told(
            code is not None and code.mappable, "no 603Fh" if code is None else _section(code)
        ),
    }


def _temperature(sheet: DataSheet) -> dict[str, dict[str, Told]]:
    """A temperature where TPDO3 would be empty without one; all others are for a question."""
    code = sheet.get(Object.ERROR_CODE)
    one = next((one for one in _named(sheet, "temperature") if one.mappable), None)
    if one is None or (code is not None and code.mappable):
        return {}
    place = {key: Told(value, _section(one)) for key, value in _ref(one).items()}
    ask = f"is {_listed([one])} the motor's or the drive's temperature, in which unit?"
    scale = {"degc_per_count": Told(1.0, "by its name", ask)}
    return {"temperature": {**place, "mapped": Told(True, _section(one)), **scale}}


def _written(sheet: DataSheet) -> Iterator[dict[str, Told]]:
    for index, (preferred, why) in _CODES.items():
        one = _at(sheet, index, written=True)
        if one is None:
            continue
        values = [v for v in preferred if _in_limits(one, v)]
        bounded = one.low is not None and one.high is not None
        value = values[0] if values else preferred[0]
        legal = sorted(values) if bounded and values else [value]
        known = bounded or value == one.default
        ask = "" if known else f"does the drive accept {value}? Its default is {one.default}"
        yield _entry(one, Told(value, _section(one), ask), legal, why)
    if (one := _at(sheet, Object.ERROR_BEHAVIOUR, 1, written=True)) is not None:
        why = "without its master the drive leaves operational and waits to be started again"
        yield _entry(one, Told(0, _section(one)), [0], why)
    if (one := _at(sheet, Object.FOLLOWING_TIME, written=True)) is not None:
        why = "permitted time outside the following error window, in ms"
        yield _entry(one, Told(0, _section(one)), [0], why)


def _entry(one: Variable, value: Told, legal: list[int], why: str) -> dict[str, Told]:
    place = {key: Told(part, _section(one)) for key, part in _ref(one).items()}
    return {**place, "value": value, "legal": Told(legal, value.source), "why": Told(why, CIA)}


def _in_limits(one: Variable, value: int) -> bool:
    return (one.low is None or one.low <= value) and (one.high is None or value <= one.high)


def _checked(sheet: DataSheet) -> Iterator[dict[str, Told]]:
    whys = {
        (_POSITION_UNIT, 0): "unit of positions as delivered",
        (_SPEED_UNIT, 0): "unit of speeds as delivered",
        (_GEAR_RATIO, 1): "no gear in the drive: it is in the axis file",
        (_GEAR_RATIO, 2): "no gear in the drive: it is in the axis file",
    }
    for (index, sub), why in whys.items():
        one = _at(sheet, index, sub)
        if one is None or not isinstance(one.default, int) or not one.default:
            continue
        place = {key: Told(part, _section(one)) for key, part in _ref(one).items()}
        value = 1 if index == _GEAR_RATIO else one.default
        yield {
            **place,
            "value": Told(value, f"{_section(one)}, DefaultValue"),
            "mask": Told(0xFFFFFFFF, "the whole object"),
            "why": Told(why, CIA),
        }


def _top(sheet: DataSheet, file: str, written: list[dict[str, Told]]) -> dict[str, Told]:
    unit = sheet.get(_SPEED_UNIT)
    in_rpm = unit is not None and unit.default == _RPM
    quick = next((row for row in written if row["index"].value == Object.QUICK_STOP), None)
    holds = quick is not None and quick["value"].value in range(5, 9)
    source = f"[60A9] DefaultValue={_RPM:08X}h is rpm" if in_rpm else file
    speeds = "" if in_rpm else "in which unit are 6080h and 606Ch?"
    ramps = "" if in_rpm else "in which unit is 6085h?"
    brakes = "how long until a faulted drive gives no torque, by 605Eh from full speed?"
    resume = "does enabling leave quick stop active by transition 16?"
    inputs = "which bits of 60FDh can no input set? Reserved are 4 to 15"
    return {
        "velocity_unit": Told("rpm" if in_rpm else "counts_per_s", source, speeds),
        "deceleration_unit": Told("rpm_per_s" if in_rpm else "counts_per_s2", source, ramps),
        "fault_reaction_max_ms": Told(500, "the EDS cannot tell", brakes),
        "resume_from_quick_stop": Told(holds, "605Ah below", resume if holds else ""),
        "inputs_always_zero": Told(0x0000FFF0, CIA, inputs),
    }


def _notes(sheet: DataSheet, identity: dict[str, int | None]) -> Iterator[str]:
    hot = [one for one in _named(sheet, r"temperature") if not one.writable]
    if hot:
        yield f"temperature: which is the motor's or the drive's, in which unit? {_listed(hot[:6])}"
    else:
        yield "temperature: no object's name says so; its limit is not monitored"
    if constants := _named(sheet, r"torque.?constant"):
        yield f"is {_listed(constants[:1])} in uN m/A? Then it is torque_base.torque_constant"
    yield "emergencies: an EDS names no EMCY codes; each unknown one is an alarm, and stops"
    modes = sheet.get(Object.SUPPORTED_MODES)
    if modes is not None and not modes.default:
        yield "6502h has no value in the file: does it show bits 7 and 9 (CSP and CST)?"
    if sheet.has(Object.HOMING_METHOD):
        yield "homing: which methods of 6098h work, and what reads 6064h at home? Left out here"
    for key, name in (("vendor_id", "01"), ("product_code", "02"), ("revision", "03")):
        if identity[key] is None:
            yield f"identity.{key}: 1018h:{name} has no value in the file; `gaitd scan` reads it"
    for fault in sheet.faults[:10]:
        yield f"the file: {fault}"


# --- against the service --------------------------------------------------------------------------


def _obstacles(proposal: Proposal, sheet: DataSheet, file: str, node_id: int) -> Iterator[str]:
    """What keeps the service from using it, as `gaitd check` says it."""
    profile = msgspec.convert(profile_table(proposal, file), DriveProfile, strict=False)
    base = proposal.tables["torque_base"]
    raw = {f"{key}_raw": value for key, value in _MOTOR_RAW.items() if key in base}
    if "rated_torque" in base:
        raw["rated_torque_raw"] = _RATED_RAW[str(base["rated_torque_unit"].value)]
    identity = {key: value or 0 for key, value in proposal.identity.items() if key != "serial"}
    axis = msgspec.convert(
        {
            "profile": file,
            "eds": file,
            "node_id": node_id,
            "identity": identity,
            "transmission": {
                "kind": "rotary",
                "gear_ratio": 100.0,
                "sign": 1,
                "counts_per_rev": 4096,
                "offset_rad": 0.0,
            },
            "encoder": {"absolute": True},
            "motor": {**_MOTOR, **raw},
            "inputs": {
                "hand_switch_closed": {"bit": 16, "level": 1},
                "sto_released": {"bit": 17, "level": 1},
            },
        },
        AxisFile,
    )
    yield from (str(error) for error in contradictions(profile, axis))
    description = DriveDescription("right/hip", profile, axis, file)
    for line in objections(plan(description, _LIMITS, _CYCLE), sheet):
        if not (line.startswith(_JUDGED_BY_THE_MACHINE) and "is outside" in line):
            yield line


# --- text -----------------------------------------------------------------------------------------


def as_toml(proposal: Proposal, file: str) -> str:
    """The proposal as a profile file: each line with its source, questions above."""
    plain = profile_table(proposal, file)
    lines = [f"# Proposed by `gaitd drive profile` from {file}; nothing is proved.", "#"]
    lines += [f"# It cannot be used: {one}" for one in proposal.obstacles]
    lines += [f"# To be found out: {one}" for one in proposal.questions]
    lines += [f"# identity.{key} = {_toml(key, value)}" for key, value in _known(proposal)]
    for key in ("vendor", "family", "verified_on_hardware", "must_show"):
        lines.append(f"{key} = {_toml(key, plain[key])}")
    lines += [f"{name} = []" for name, rows in proposal.lists.items() if not rows]
    for name, table in proposal.tables.items():
        lines += ["", f"[{name}]"] if name else []
        lines += [_line(key, told) for key, told in table.items()]
    for name, rows in proposal.lists.items():
        for row in rows:
            lines += ["", f"[[{name}]]", *(_line(key, told) for key, told in row.items())]
    for source in msgspec.convert(plain["sources"], list[dict[str, str | list[str]]]):
        lines += ["", "[[sources]]"]
        lines += [f"{key} = {_toml(key, value)}" for key, value in source.items()]
    return "\n".join(lines) + "\n"


def _known(proposal: Proposal) -> Iterator[tuple[str, int]]:
    for key, value in proposal.identity.items():
        if value is not None:
            yield key, value


def _line(key: str, told: Told) -> str:
    asked = " (to be found out)" if told.question else ""
    return f"{key} = {_toml(key, told.value)}  # {told.source}{asked}"


_HEXADECIMAL: Final = frozenset(
    ("index", "mask", "inputs_always_zero", "vendor_id", "product_code", "revision", "serial")
)


def _toml(key: str, value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case int() if key in _HEXADECIMAL or value > 0xFFFF:
            return f"0x{value:X}"
        case dict():
            members = msgspec.convert(value, dict[str, int | bool])
            return "{ " + ", ".join(f"{k} = {_toml(k, v)}" for k, v in members.items()) + " }"
        case list():
            members = msgspec.convert(value, list[int | str])
            return "[" + ", ".join(_toml(key, one) for one in members) + "]"
        case str():
            return msgspec.json.encode(value).decode()
        case _:
            return str(value)


def _printable(text: str) -> str:
    return "".join(one if one.isprintable() else "?" for one in text)
