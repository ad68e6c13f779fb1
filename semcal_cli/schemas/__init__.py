"""JSON Schemas of drive.yaml, rig.yaml, the calibration and model cards, for editors and other tools.

`python -m semcal_cli.schemas` regenerates them from the models.
"""

import json
from pathlib import Path

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
    return json.dumps(dialect | model.model_json_schema(), indent=2) + "\n"
