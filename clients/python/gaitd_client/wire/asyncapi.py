"""An AsyncAPI document of all messages, for generators and readers of other languages.

It describes what the service does: it sends what is published, receives setpoints, and answers
queries. The address of a channel is a Zenoh key. The display's server offers what is published
over WebSocket, too, in frames.
"""

from importlib.metadata import version
from typing import Any, Final

import msgspec

from gaitd_client.wire.messages import CONTROL, MESSAGES, READING, schema_name

ASYNCAPI: Final = "3.0.0"
PUBLISHED: Final = {
    "estimate": "{leg}/estimate",
    "activity": "{leg}/activity",
    "friction": "{leg}/friction",
    "stride": "{leg}/stride",
    "controller": "{leg}/controller",
    "drives": "drives/{leg}/{axis}",
    "safety": "safety",
    "events": "events",
    "health": "health",
}
"""Key behind `gaitd/TRAINER/` of each message that is published."""
ACTING: Final = (
    "acquire", "release", "report", "enable", "disable", "stop", "reset", "mode", "plan", "mark",
    "restart",
)  # fmt: skip
"""Queries that are answered by a reply; the others are answered by the message of their name."""
PARAMETERS: Final[dict[str, dict[str, Any]]] = {
    "trainer": {"default": "trainer", "description": "Name of the trainer in its file."},
    "leg": {"enum": ["right", "left"]},
    "axis": {"enum": ["hip", "slide"]},
}
FRAME: Final = {
    "type": "object",
    "required": ["seq", "dropped_count", "messages"],
    "properties": {
        "seq": {"type": "integer", "description": "Sent back as text when the frame has come."},
        "dropped_count": {"type": "integer", "description": "Messages replaced by newer ones."},
        "messages": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["key", "schema", "value", "trouble", "text"],
                "properties": {
                    "key": {"type": "string", "description": "Behind `gaitd/TRAINER/`."},
                    "schema": {"type": "string", "description": "`gaitd.NAME.v1` of the value."},
                    "value": {"type": ["object", "null"], "description": "Null: not known."},
                    "trouble": {"type": ["string", "null"], "description": "silent, unreadable"},
                    "text": {"type": "string", "description": "The trouble in words."},
                },
            },
        },
    },
}
"""A frame of the WebSocket `/messages` of the display's server."""


def asyncapi() -> dict[str, Any]:
    """Return the document: AsyncAPI 3.0, its schemas in it."""
    kinds, schemas = msgspec.json.schema_components(
        MESSAGES.values(), ref_template="#/components/schemas/{name}"
    )
    messages = {
        name: {
            "name": schema_name(kind),
            "contentType": "application/json",
            "summary": " ".join((kind.__doc__ or "").split()),
            "payload": one,
        }
        for (name, kind), one in zip(MESSAGES.items(), kinds, strict=True)
    }
    messages["frame"] = {"name": "frame", "contentType": "application/json", "payload": FRAME}
    messages["received"] = {
        "name": "received",
        "contentType": "text/plain",
        "payload": {"type": "string"},
    }
    channels: dict[str, Any] = {}
    operations: dict[str, Any] = {}
    for name, key in (PUBLISHED | {"setpoint": "{leg}/setpoint"}).items():
        channels[name] = _channel(key, name)
        action = "receive" if name == "setpoint" else "send"
        operations[f"{action}_{name}"] = _operation(action, name, name)
    for name in (*ACTING, *sorted(READING)):
        asked = name if name in MESSAGES and name not in READING else "ask"
        answer = name if name in READING else "reply"
        channel = f"control_{name}"
        channels[channel] = _channel(f"{CONTROL}/{name}", asked, answer)
        operations[channel] = _operation("receive", channel, asked) | {
            "reply": {"channel": _to("channels", channel), "messages": [_of(channel, answer)]}
        }
    channels["messages"] = {
        "address": "/messages",
        "servers": [_to("servers", "display")],
        "description": "Over WebSocket; `key` may be given several times.",
        "messages": {one: _to("components", "messages", one) for one in ("frame", "received")},
        "bindings": {
            "ws": {"query": {"type": "object", "properties": {"key": {"type": "string"}}}}
        },
    }
    operations["send_frame"] = _operation("send", "messages", "frame")
    operations["receive_received"] = _operation("receive", "messages", "received")
    return {
        "asyncapi": ASYNCAPI,
        "info": {
            "title": "gaitd",
            "version": version("gaitd-client"),
            "description": "Messages of the drive service of a home gait trainer.",
        },
        "defaultContentType": "application/json",
        "servers": {
            "gateway": {"host": "127.0.0.1:7447", "protocol": "zenoh"},
            "display": {"host": "127.0.0.1:8090", "protocol": "ws"},
        },
        "channels": channels,
        "operations": operations,
        "components": {"messages": messages, "schemas": schemas},
    }


def _channel(key: str, *messages: str) -> dict[str, Any]:
    address = f"gaitd/{{trainer}}/{key}"
    return {
        "address": address,
        "servers": [_to("servers", "gateway")],
        "messages": {name: _to("components", "messages", name) for name in messages},
        "parameters": {name: one for name, one in PARAMETERS.items() if f"{{{name}}}" in address},
    }


def _operation(action: str, channel: str, message: str) -> dict[str, Any]:
    of = {"channel": _to("channels", channel), "messages": [_of(channel, message)]}
    return {"action": action, **of}


def _of(channel: str, message: str) -> dict[str, str]:
    return _to("channels", channel, "messages", message)


def _to(*parts: str) -> dict[str, str]:
    return {"$ref": "#/" + "/".join(parts)}
