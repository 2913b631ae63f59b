"""`python -m gaitd_client.wire`: write the JSON Schemas as files, from the types."""

from gaitd_client.wire.messages import SCHEMAS_FOLDER, schema_texts

if __name__ == "__main__":
    SCHEMAS_FOLDER.mkdir(exist_ok=True)
    for name, text in schema_texts().items():
        (SCHEMAS_FOLDER / name).write_text(text, encoding="utf-8")
