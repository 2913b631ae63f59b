"""Types of the messages in TypeScript, for the module of pages: made from the JSON Schemas."""

from collections.abc import Iterator
from typing import Any, Final

import msgspec
from gaitd_client import wire
from gaitd_client.wire.asyncapi import PARAMETERS, PUBLISHED

KINDS: Final = {"string": "string", "integer": "number", "number": "number", "boolean": "boolean"}
KINDS_OF_OTHERS: Final = {"null": "null", "object": "Record<string, unknown>", "array": "unknown[]"}


def declarations() -> str:
    """Return the types of all published messages, and which key has which."""
    kinds = [wire.MESSAGES[name] for name in PUBLISHED]
    _, schemas = msgspec.json.schema_components(kinds, ref_template="{name}")
    lines = [line for name, one in sorted(schemas.items()) for line in _interface(name, one)]
    lines += ["export interface Messages {"]
    for name, key in PUBLISHED.items():
        kind = wire.MESSAGES[name].__name__
        lines += [f'  "{one}": {kind};' for one in _keys(key)]
    return "\n".join([*lines, "}"])


def _keys(key: str) -> list[str]:
    """Return the keys of a pattern, for each leg and axis."""
    keys = [key]
    for name in ("leg", "axis"):
        values = PARAMETERS[name]["enum"]
        keys = list(
            dict.fromkeys(one.replace(f"{{{name}}}", value) for one in keys for value in values)
        )
    return keys


def _interface(name: str, schema: dict[str, Any]) -> Iterator[str]:
    if "properties" not in schema:
        yield f"export type {name} = {_type(schema)};"
        return
    if said := schema.get("description"):
        yield f"/** {' '.join(said.split())} */"
    yield f"export interface {name} {{"
    required = schema.get("required", ())
    for field, one in schema["properties"].items():
        if said := one.get("description"):
            yield f"  /** {said} */"
        yield f"  {field}{'' if field in required else '?'}: {_type(one)};"
    yield "}"


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        return str(schema["$ref"])
    for several in ("anyOf", "oneOf"):
        if several in schema:
            kinds = dict.fromkeys(map(_type, schema[several]))
            # An open enum: an editor offers its names, and any other text is allowed.
            has_names = any(kind.startswith('"') for kind in kinds)
            return " | ".join(
                "(string & {})" if has_names and kind == "string" else kind for kind in kinds
            )
    if "enum" in schema:
        return " | ".join(msgspec.json.encode(one).decode() for one in schema["enum"])
    match schema.get("type"):
        case "array" if schema.get("items"):
            return f"readonly ({_type(schema['items'])})[]"
        case "object" if isinstance(schema.get("additionalProperties"), dict):
            return f"Record<string, {_type(schema['additionalProperties'])}>"
        case str(kind):
            return {**KINDS, **KINDS_OF_OTHERS}[kind]
        case _:
            return "unknown"
