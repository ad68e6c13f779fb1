"""JSON Schemas of the documents that people write and read, for editors and other tools.

`python -m semcal_cli.schemas` regenerates the schemas of the newest version from the models. The documentation site
publishes the schemas of all versions at the addresses that they state as `$id`.
"""

import ast
import inspect
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import ModelSchema

from semcal_cli.documentation import schema_address, schema_name
from semcal_cli.drive.document import Drive
from semcal_cli.files.validation import NEWEST_VERSION, StrictModel
from semcal_cli.labelling.card import CloudCard, ImageCard, PointCard
from semcal_cli.many.rig.rig_document import Rig
from semcal_cli.many.rig.rig_result import RigResult
from semcal_cli.result.calibration_document import CalibrationDocument

FOLDER = Path(__file__).parent
MODELS: dict[str, Any] = {
    "semcal_drive": Drive,
    "semcal_rig": Rig,
    "semcal_calibration": CalibrationDocument,
    "semcal_rig_calibration": RigResult,
    "semcal_image_model": ImageCard,
    "semcal_point_model": PointCard | CloudCard,
}
"""Model of each document, by its first key."""


def schema_file(key: str) -> Path:
    """Return the file of the JSON Schema of the newest version of a document, by its first key."""
    return FOLDER / schema_name(key, NEWEST_VERSION)


def schema_text(key: str) -> str:
    """Format the JSON Schema of the newest version of a document as text, by its first key."""
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": schema_address(key, NEWEST_VERSION),
    }
    return (
        json.dumps(
            head | TypeAdapter(MODELS[key]).json_schema(schema_generator=_DescribingGenerator), indent=2
        )
        + "\n"
    )


class _DescribingGenerator(GenerateJsonSchema):
    """Generator that describes each property by the docstring of its field.

    Pydantic's `use_attribute_docstrings` does the same, but reads the sources at each start of semcal.
    """

    def model_schema(self, schema: ModelSchema) -> JsonSchemaValue:
        """Make the JSON Schema of a model."""
        json_schema = super().model_schema(schema)
        for model in reversed(schema["cls"].mro()):
            for name, text in _docstrings(model).items() if issubclass(model, StrictModel) else ():
                key = schema["cls"].model_fields[name].alias or name
                field_schema = json_schema["properties"][key] | {"description": text}
                json_schema["properties"][key] = self.handle_ref_overrides(field_schema)
        return json_schema


def _docstrings(model: type) -> dict[str, str]:
    """Read the docstrings of the fields that a class itself defines."""
    (definition,) = ast.parse(inspect.getsource(model)).body
    assert isinstance(definition, ast.ClassDef)
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in pairwise(definition.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }
