"""TOML files into structs, for the service and its clients, without loading the client's network.

Reading order: `reader.py` (one file, checked by msgspec; all its mistakes), `error.py` (a mistake:
file, key, value and what is allowed).
"""

from gaitd_toml.error import COMMAND_LINE, MISSING, ConfigError, Errors, PlainText
from gaitd_toml.reader import (
    SMALLEST,
    Document,
    decoded,
    errors_in,
    load_toml,
    parse_toml,
    read_bytes,
    read_toml,
)

__all__ = [
    "COMMAND_LINE",
    "MISSING",
    "SMALLEST",
    "ConfigError",
    "Document",
    "Errors",
    "PlainText",
    "decoded",
    "errors_in",
    "load_toml",
    "parse_toml",
    "read_bytes",
    "read_toml",
]
