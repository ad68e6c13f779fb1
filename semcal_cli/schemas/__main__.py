"""Command that writes the schemas beside this file."""

from semcal_cli.schemas import MODELS, schema_file, schema_text

for key in MODELS:
    schema_file(key).write_text(schema_text(key), encoding="utf-8")
