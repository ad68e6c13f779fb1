"""JSON Schemas of drive.yaml, rig.yaml, the calibration and model cards, for editors and other tools.

`python -m semcal_cli.schemas` regenerates them from the models.
"""

import ast
import inspect
import json
from itertools import pairwise
from pathlib import Path

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import ModelSchema

from semcal_cli.drive.document import Drive
from semcal_cli.files.validation import StrictModel
from semcal_cli.labelling.card import PictureCard, PointCard
from semcal_cli.result.calibration import Calibration
from semcal_cli.rig.document import Rig

FOLDER = Path(__file__).parent
SCHEMAS: dict[str, type[StrictModel]] = {
    "drive.schema.json": Drive,
    "rig.schema.json": Rig,
    "calibration.schema.json": Calibration,
    "picture_card.schema.json": PictureCard,
    "point_card.schema.json": PointCard,
}


def schema_text(model: type[StrictModel]) -> str:
    """Format the JSON Schema of a model as text."""
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return json.dumps(dialect | model.model_json_schema(schema_generator=_Described), indent=2) + "\n"


class _Described(GenerateJsonSchema):
    """Describes each property by the docstring of its field.

    Pydantic's `use_attribute_docstrings` does so, too, but reads the sources at each start of semcal.
    """

    def model_schema(self, schema: ModelSchema) -> JsonSchemaValue:
        """Make the JSON Schema of a model."""
        made = super().model_schema(schema)
        for model in reversed(schema["cls"].mro()):
            for name, text in _docstrings(model).items() if issubclass(model, StrictModel) else ():
                described = made["properties"][name] | {"description": text}
                made["properties"][name] = self.handle_ref_overrides(described)
        return made


def _docstrings(model: type) -> dict[str, str]:
    """Read the docstrings of the fields that a class itself has."""
    (found,) = ast.parse(inspect.getsource(model)).body
    assert isinstance(found, ast.ClassDef)
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in pairwise(found.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }
