"""Every field of a message, every key of a file, and the queries of the gateway.

Names, ranges and meanings are those of the types that decode them: a message has its descriptions
in `Meta`, a table of a file in the texts below its fields.
"""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from functools import cache
from itertools import pairwise, starmap
from typing import Final, cast

import msgspec
from gaitd_client import wire
from gaitd_client.wire.fields import QUANTITY, Estimated, Stated
from gaitd_client.wire.messages import NAME_OF, Ask
from msgspec import inspect as types

from analysis import markdown
from daemon.config.limit_settings import Limits
from daemon.config.settings import Robot, Trainer
from daemon.gateway.requests import ROUTES, Route
from drives.cia402.axis_file import AxisFile
from drives.cia402.profile import DriveProfile

LARGEST: Final = 2**53 - 1
"""The largest whole number that every reader of JSON keeps."""
BOUNDS: Final = (("ge", "≥"), ("gt", ">"), ("le", "≤"), ("lt", "<"))


FILES: Final[dict[str, type[msgspec.Struct]]] = {
    "trainer.toml, demo.toml, vcan.toml": Trainer,
    "robot.toml, robot_empty.toml": Robot,
    "limits.toml": Limits,
    "drives/AXIS.toml": AxisFile,
    "drives/profiles/PROFILE.toml": DriveProfile,
}
DOCUMENTED: Final = ("daemon", "drives", "gaitd_assist", "gaitd_display", "gaitd_session")
"""Packages whose classes describe a file; base classes of others have no keys of their own."""


# --- messages -------------------------------------------------------------------------------------


def message_parts() -> dict[str, str]:
    """Return the generated parts of docs/messages.md by name."""
    parts: list[str] = []
    for name, kind in wire.MESSAGES.items():
        parts += [f"## {name}", f"{' '.join((kind.__doc__ or '').split())}{_more(kind)}"]
        rows = list(_field_rows(kind))
        if rows:
            parts.append(markdown.table(("field", "type", "meaning"), rows))
    queries = markdown.table(("key", "payload", "answer"), starmap(_query_row, ROUTES.items()))
    columns = ("field", "type", "meaning")
    heads = {"head": _named_rows("", _fields(Stated)), "leg": _named_rows("", _own(Estimated))}
    tables = {name: markdown.table(columns, rows) for name, rows in heads.items()}
    return {"queries": queries, "fields": "\n\n".join(parts), **tables}


def _query_row(name: str, route: Route) -> tuple[str, str, str]:
    answers = route is Route.GATEWAY
    payload = name if name in wire.MESSAGES and not answers else "ask"
    answer = name if answers else "reply"
    return f"`control/{name}`", f"[{payload}](#{payload})", f"[{answer}](#{answer})"


def _field_rows(kind: type[msgspec.Struct]) -> Iterator[tuple[str, str, str]]:
    """Yield the rows of a message; those of its axes, which have the same fields, once."""
    own = _own(kind)
    axes = [_bare(field.type) for field in own if field.name in wire.JOINTS]
    if axes and isinstance(axes[0], types.StructType):
        yield from _named_rows("AXIS.", axes[0].fields)
        own = tuple(field for field in own if field.name not in wire.JOINTS)
    yield from _named_rows("", own)


def _own(kind: type[msgspec.Struct]) -> tuple[types.Field, ...]:
    """Return the fields but those that the page tells once for many messages."""
    told = next((one for one in (Estimated, Stated, Ask) if issubclass(kind, one)), None)
    if kind in {Estimated, Ask}:
        told = Stated if kind is Estimated else None
    names = {field.name for field in _fields(told)} if told else set()
    return tuple(field for field in _fields(kind) if field.name not in names)


def _more(kind: type[msgspec.Struct]) -> str:
    if issubclass(kind, Ask) and kind is not Ask:
        return " It has the fields of [ask](#ask), too."
    return (
        " It has the [fields of a leg](#of-an-estimate), too."
        if issubclass(kind, Estimated)
        else ""
    )


def _named_rows(path: str, fields: tuple[types.Field, ...]) -> Iterator[tuple[str, str, str]]:
    """Yield the rows of fields; a standard deviation stands beside its quantity."""
    names = {field.name for field in fields}
    for field in fields:
        if field.name.removesuffix("_std") in names - {field.name}:
            continue
        std = f"{field.name}_std"
        shown = (field.name, std) if std in names else (field.name,)
        yield _field_row(", ".join(f"`{path}{name}`" for name in shown), field)


def _field_row(name: str, field: types.Field) -> tuple[str, str, str]:
    extra = field.type.extra_json_schema or {} if isinstance(field.type, types.Metadata) else {}
    kind = _type_text(field.type)
    if QUANTITY in extra:
        units = (getattr(joint, str(extra[QUANTITY])) for joint in wire.JOINTS.values())
        kind = f"{kind}; {', '.join(units)}"
    return name, kind, str(extra.get("description", ""))


# --- files ----------------------------------------------------------------------------------------


def configuration_parts() -> dict[str, str]:
    """Return the generated part of docs/configuration.md by name."""
    parts: list[str] = []
    for file, kind in {**FILES, **_files_of_clients()}.items():
        parts += [f"## {file}", *_tables("", kind)]
    return {"keys": "\n\n".join(parts)}


def _files_of_clients() -> dict[str, type[msgspec.Struct]]:
    """Return the files of the programs around the service, which a developer has installed."""
    from gaitd_assist.settings import Settings
    from gaitd_display.settings import EngineerSettings, PatientSettings, TherapistSettings
    from gaitd_session.profile import Profile

    return {
        "patient.toml (gaitd-display)": PatientSettings,
        "therapist.toml (gaitd-display)": TherapistSettings,
        "engineer.toml (gaitd-display)": EngineerSettings,
        "assist.toml (gaitd-assist)": Settings,
        "training profile (gaitd-session)": Profile,
    }


def _tables(path: str, kind: type[msgspec.Struct]) -> Iterator[str]:
    """Yield the table of a struct's own keys, then those of the tables in it."""
    rows: list[tuple[str, ...]] = []
    inner: list[tuple[str, type[msgspec.Struct]]] = []
    texts = _texts(kind)
    for field in _fields(kind):
        name = f"{path}.{field.name}".lstrip(".")
        tables = list(_structs(field.type))
        if tables:
            inner += [(f"{name}{_suffix(field.type)}", one) for one in tables]
            continue
        rows.append((f"`{field.name}`", _type_text(field.type), _default(field), texts[field.name]))
    if path:
        yield f"### [{path}]"
        yield " ".join((kind.__doc__ or "").split())
    if rows:
        yield markdown.table(("key", "type", "default", "meaning"), rows)
    for name, one in inner:
        yield from _tables(name, one)


def _suffix(kind: types.Type) -> str:
    bare = _bare(kind)
    if isinstance(bare, types.DictType):
        return ".NAME"
    return "[]" if isinstance(bare, types.VarTupleType | types.ListType) else ""


def _structs(kind: types.Type) -> Iterator[type[msgspec.Struct]]:
    match _bare(kind):
        case types.StructType(cls=struct):
            yield struct
        case types.UnionType(types=members):
            for member in members:
                yield from _structs(member)
        case types.VarTupleType(item_type=item) | types.ListType(item_type=item):
            yield from _structs(item)
        case types.DictType(value_type=value):
            yield from _structs(value)
        case _:
            pass


def _default(field: types.Field) -> str:
    if field.required:
        return ""
    if field.default is None:
        return "none"
    has_value = isinstance(field.default, bool | int | float | str)
    return f"`{field.default}`" if has_value else "see the file"


@cache
def _texts(kind: type[msgspec.Struct]) -> dict[str, str]:
    """Texts below the fields of a class, by name; Python keeps them in the source only.

    A key of the slide without a text has that of the hip's key at the same place: `SlideLimits` is
    `HipLimits` with other units.
    """
    found = dict.fromkeys((field.name for field in _fields(kind)), "")
    for one in reversed(kind.__mro__):
        if one.__module__.split(".")[0] not in DOCUMENTED:
            continue
        twin = getattr(inspect.getmodule(one), one.__name__.replace("Slide", "Hip", 1), one)
        hip_texts = dict(zip(one.__annotations__, _own_texts(twin).values(), strict=False))
        found |= {name: text or hip_texts[name] for name, text in _own_texts(one).items()}
    return found


@cache
def _own_texts(kind: type) -> dict[str, str]:
    """Texts below the fields that the class itself declares, in their order."""
    made = cast("ast.ClassDef", ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0])
    found: dict[str, str] = {}
    for before, node in pairwise([*made.body, ast.Pass()]):
        match before, node:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str() as text)),
            ):
                found[name] = re.sub(r"\s+", " ", text)
            case ast.AnnAssign(target=ast.Name(id=name)), _:
                found[name] = ""
            case _:
                pass
    return found


# --- both -----------------------------------------------------------------------------------------


def _fields(kind: type[msgspec.Struct]) -> tuple[types.Field, ...]:
    return cast("types.StructType", types.type_info(kind)).fields


def _bare(kind: types.Type) -> types.Type:
    return _bare(kind.type) if isinstance(kind, types.Metadata) else kind


def _type_text(kind: types.Type) -> str:
    bare = _bare(kind)
    match bare:
        case types.UnionType(types=members):
            return " or ".join(map(_type_text, members))
        case types.LiteralType(values=values):
            return ", ".join(f"`{value}`" for value in values)
        case types.EnumType(cls=enum):
            return ", ".join(f"`{member.value}`" for member in enum)
        case types.StructType(cls=struct):
            name = NAME_OF.get(struct)
            return f"[{name}](#{name})" if name else _inline(struct)
        case types.VarTupleType(item_type=item) | types.ListType(item_type=item):
            return f"array of {_item_text(item)}"
        case types.TupleType(item_types=items):
            return f"[{', '.join(map(_type_text, items))}]"
        case types.DictType(value_type=value):
            return f"object of {_item_text(value)}"
        case types.CustomType(cls=custom):
            return custom.__name__.lower()
        case _:
            word = WORDS.get(type(bare), type(bare).__name__.removesuffix("Type").lower())
            return f"{word}{_range(bare)}"


def _item_text(kind: types.Type) -> str:
    text = _type_text(kind)
    return f"({text})" if isinstance(_bare(kind), types.UnionType) else text


WORDS: Final[dict[type[types.Type], str]] = {
    types.FloatType: "number",
    types.IntType: "integer",
    types.StrType: "text",
    types.BoolType: "true, false",
    types.NoneType: "null",
    types.AnyType: "anything",
}


def _inline(struct: type[msgspec.Struct]) -> str:
    return "{" + ", ".join(map(_inline_field, _fields(struct))) + "}"


def _inline_field(field: types.Field) -> str:
    inner = _bare(field.type)
    structs = f": {_inline(inner.cls)}" if isinstance(inner, types.StructType) else ""
    return f"`{field.name}`{structs}"


def _range(kind: types.Type) -> str:
    bounds = [
        f"{sign} {'2^53 − 1' if value == LARGEST else f'{value:g}'}"
        for name, sign in BOUNDS
        if (value := getattr(kind, name, None)) is not None
    ]
    return f" {', '.join(bounds)}" if bounds else ""
