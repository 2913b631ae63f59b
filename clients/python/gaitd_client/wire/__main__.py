"""`python -m gaitd_client.wire FOLDER`: write the JSON Schemas and an AsyncAPI document."""

import json
import sys
from pathlib import Path

from gaitd_client.wire.asyncapi import asyncapi
from gaitd_client.wire.messages import schemas

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, one in {**schemas(), "asyncapi": asyncapi()}.items():
        text = json.dumps(one, indent=1, ensure_ascii=False)
        (folder / f"{name}.json").write_text(f"{text}\n", encoding="utf-8")
