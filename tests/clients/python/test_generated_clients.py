"""Clients that a tool makes of the schemas read messages of v1, also those of a later version."""

import gzip
import json
from functools import cache
from pathlib import Path

import pytest
from datamodel_code_generator import DataModelType, InputFileType, generate
from gaitd_client import wire

TRAFFIC = Path(__file__).parents[2] / "traces" / "traffic_v1.jsonl.gz"
SENT = [json.loads(line) for line in gzip.decompress(TRAFFIC.read_bytes()).splitlines()]
LATER = "a_name_of_a_later_version"


@cache
def generated(schema):
    """The class that reads a message, made of its schema."""
    namespace = {}
    made = generate(
        json.dumps(wire.schemas()[schema]),
        input_file_type=InputFileType.JsonSchema,
        output_model_type=DataModelType.PydanticV2BaseModel,
        class_name="Message",
        formatters=[],
    )
    exec(made, namespace)
    namespace["Message"].model_rebuild(_types_namespace=namespace)
    return namespace["Message"]


def of_later(value, schema, root):
    """A value as a later version sends it: a field more in each object, other names in enums."""
    if "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rpartition("/")[2]]
    kinds = schema.get("anyOf", [])
    if isinstance(value, str) and any("enum" in kind for kind in kinds):
        return LATER
    if value is not None and kinds:
        return of_later(value, next(kind for kind in kinds if kind != {"type": "null"}), root)
    if isinstance(value, list):
        return [of_later(one, schema["items"], root) for one in value]
    if isinstance(value, dict) and "properties" in schema:
        fields = schema["properties"]
        known = {name: of_later(one, fields[name], root) for name, one in value.items()}
        return known | {"added_later": [1, "two", None]}
    if isinstance(value, dict) and isinstance(schema.get("additionalProperties"), dict):
        inner = schema["additionalProperties"]
        return {name: of_later(one, inner, root) for name, one in value.items()}
    return value


def without_added(value):
    if isinstance(value, dict):
        return {name: without_added(one) for name, one in value.items() if name != "added_later"}
    return [without_added(one) for one in value] if isinstance(value, list) else value


@pytest.mark.parametrize("sent", SENT, ids=lambda sent: sent["key"])
def test_a_generated_client_reads_what_this_version_sends_and_a_later_one_may_send(sent):
    schema, message = wire.schemas()[sent["schema"]], json.loads(sent["payload"])
    client = generated(sent["schema"])

    assert client.model_validate(message).model_dump(mode="json", exclude_unset=True) == message
    later = of_later(message, schema, schema)
    read = client.model_validate(later).model_dump(mode="json", exclude_unset=True)
    assert read == without_added(later) != later
    if sent["schema"] == "gaitd.estimate.v1":
        assert {read["mode"], read["status"][0], read["hip"]["validity"]} == {LATER}


@pytest.mark.parametrize("name", ["estimate", "activity", "friction", "stride", "setpoint"])
def test_a_generated_client_has_the_same_class_for_both_axes(name):
    fields = generated(f"gaitd.{name}.v1").model_fields

    assert fields["hip"].annotation is fields["slide"].annotation
