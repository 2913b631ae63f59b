"""`gaitd drive NAME dump` and `compare`: read one drive's objects, or compare them."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from daemon.config.strict import ConfigError
from drives.bringup.configurator import Configurator
from drives.canopen.sniffer import BusSniffer
from drives.errors import BootFailure, DescriptionError, DriveSilent
from drives.service.compare import Compared, expectations, in_hex, with_plan, with_values
from drives.service.dump import (
    Entry,
    Value,
    defaults,
    read_dcf,
    read_objects,
    readable,
    settings,
    variable_at,
    write_dcf,
)
from drives.service.eds import load_eds
from drives.service.object_words import ObjectWords
from gaitd.check import Section
from gaitd.station import EXIT_DIFFERENT, EXIT_SAME, show, shown

if TYPE_CHECKING:
    from canopen.objectdictionary import ObjectDictionary

    from drives.bringup.plan import DrivePlan
    from drives.canopen.bus import Bus, Clock
    from gaitd.station import Options

EDS_DEFAULT: Final = "EDS default"


def refuse_company(plan: "DrivePlan", witness: BusSniffer) -> None:
    """Refuse to read beside another SDO client: both would break each other's transfers.

    Raises:
        DriveSilent: another client reads or writes the drive's objects now.
    """
    name, node_id = plan.description.name, plan.description.node_id
    if witness.node(node_id).foreign_request_count:
        what = "somebody else reads or writes its objects now (a service's bring-up?): try later"
        raise DriveSilent(name, BootFailure.FOREIGN_MASTER, what)


def dump(plan: "DrivePlan", options: "Options", bus: "Bus", clock: "Clock") -> int:
    """Read all readable objects; print them, or write them to a file.

    Returns: the exit code.
    """
    dictionary = _dictionary(plan)
    port = Configurator(bus, clock)
    reading = read_objects(plan.description.node_id, readable(dictionary), port, as_filled=True)
    entries = shown(reading)
    words = ObjectWords(plan)
    if options.output is not None:
        _write(entries, dictionary, plan, options.output)
    if options.json:
        _print_json(plan, objects=[_entry_table(entry, words) for entry in entries])
    elif options.output is not None:
        read_count = sum(entry.value is not None for entry in entries)
        print(f"{_title(plan)}: {read_count} of {len(entries)} objects in {options.output}")
    else:
        columns = ("object", "name", "value", "hex", "meaning")
        rows = tuple(_entry_row(entry, words) for entry in entries)
        show((Section(f"{_title(plan)}: {len(rows)} objects", columns, rows),))
    return EXIT_SAME


def compare(plan: "DrivePlan", options: "Options", bus: "Bus", clock: "Clock") -> int:
    """Read the objects to be compared and print those that differ.

    Returns: the exit code.
    """
    port = Configurator(bus, clock)
    against, compared = _compared(plan, options, port)
    compared = sorted(compared, key=lambda one: one.place)
    different = [one for one in compared if not one.same]
    listed = compared if options.everything else different
    if options.json:
        differences = [_compared_table(one) for one in listed]
        _print_json(plan, against=against, compared_count=len(compared), objects=differences)
    else:
        verdict = f"{len(different)} of {len(compared)} objects differ from {against}"
        columns = ("object", "name", "wanted", "found", "why")
        rows = tuple((one.place, one.name, one.wanted, one.found, one.why) for one in listed)
        show((Section(f"{_title(plan)}: {verdict}", columns, rows),))
        if not rows:
            print(f"{_title(plan)}: {verdict}")
    return EXIT_DIFFERENT if different else EXIT_SAME


def _compared(
    plan: "DrivePlan", options: "Options", port: Configurator
) -> tuple[str, tuple[Compared, ...]]:
    dictionary, node_id = _dictionary(plan), plan.description.node_id
    if options.against is None and not options.eds:
        wanted = expectations(plan)
        variables = [variable_at(dictionary, *one.address, one.step.bits) for one in wanted]
        entries = shown(read_objects(node_id, variables, port))
        found = {(entry.index, entry.sub): entry for entry in entries}
        return "what bring-up expects", with_plan(wanted, found)
    values, why = _values(dictionary, node_id, options)
    variables = [v for v in settings(dictionary) if (v.index, v.subindex) in values]
    entries = shown(read_objects(node_id, variables, port))
    against = Path(plan.description.eds) if options.eds else options.against
    return str(against), with_values(values, entries, why)


def _values(
    dictionary: "ObjectDictionary", node_id: int, options: "Options"
) -> tuple[dict[tuple[int, int], Value], str]:
    if options.against is None:
        return defaults(dictionary), EDS_DEFAULT
    with _operators_file():
        return read_dcf(str(options.against), node_id), f"as in {options.against.name}"


@contextmanager
def _operators_file() -> Generator[None]:
    """Convert an unusable file into a configuration error, since the operator named the file.

    Raises:
        ConfigError: in place of DescriptionError.
    """
    try:
        yield
    except DescriptionError as error:
        raise ConfigError(str(error.value), "", "", error.allowed) from error


def _dictionary(plan: "DrivePlan") -> "ObjectDictionary":
    with _operators_file():
        return load_eds(plan.description.eds, plan.description.node_id)


def _write(
    entries: tuple[Entry, ...], dictionary: "ObjectDictionary", plan: "DrivePlan", path: Path
) -> None:
    try:
        with path.open("w", encoding="utf-8") as file:
            write_dcf(entries, dictionary, plan.description.node_id, file)
    except OSError as error:
        allowed = f"a file that can be written ({error.strerror})"
        raise ConfigError("command line", "--output", path, allowed) from error


# --- text -----------------------------------------------------------------------------------------


def _title(plan: "DrivePlan") -> str:
    return f"{plan.description.name} (node {plan.description.node_id})"


def _meaning(entry: Entry, words: ObjectWords) -> str:
    if not isinstance(entry.value, int):
        return entry.trouble
    return words.of(entry.index, entry.sub, entry.value)


def _entry_row(entry: Entry, words: ObjectWords) -> tuple[str, ...]:
    value = "-" if entry.value is None else str(entry.value)
    hexadecimal = ""
    if isinstance(entry.value, int) and entry.bits:
        hexadecimal = in_hex(entry.value, entry.bits)
    return (entry.place, entry.name, value, hexadecimal, _meaning(entry, words))


def _entry_table(entry: Entry, words: ObjectWords) -> dict[str, Any]:
    return {
        "index": entry.index,
        "sub": entry.sub,
        "name": entry.name,
        "value": entry.value,
        "bits": entry.bits,
        "meaning": "" if entry.trouble else _meaning(entry, words),
        "trouble": entry.trouble,
    }


def _compared_table(one: Compared) -> dict[str, Any]:
    return {
        "index": one.index,
        "sub": one.sub,
        "name": one.name,
        "wanted": one.wanted,
        "found": one.found,
        "why": one.why,
        "same": one.same,
    }


def _print_json(plan: "DrivePlan", **parts: object) -> None:
    import msgspec

    head = {"drive": plan.description.name, "node_id": plan.description.node_id}
    print(msgspec.json.encode({**head, **parts}).decode())
