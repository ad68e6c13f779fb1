"""Command that writes the schemas beside this file."""

from semcal_cli.schemas import FOLDER, SCHEMAS, schema_text

for name, model in SCHEMAS.items():
    (FOLDER / name).write_text(schema_text(model), encoding="utf-8")
