"""Tables of nuScenes: JSON lists of rows with tokens (docs/schema_nuscenes.md of nutonomy/nuscenes-devkit)."""

from __future__ import annotations

from collections.abc import Collection
from itertools import islice
from pathlib import Path
from typing import Annotated, TypeAlias, TypeVar

from pydantic import BaseModel, ConfigDict, Field, RootModel

from semcal_cli.errors import InputError
from semcal_cli.files.messages import describe
from semcal_cli.files.rows import read_rows
from semcal_cli.files.validation import FileName, Vector3, Vector4, length, validate
from semcal_cli.formats.values import MAX_STAMP_S, MAX_WORLD_M
from semcal_cli.geometry.poses import Pose, pose_from_quaternion

ROWS_AT_A_TIME = 10_000
"""Rows that are checked at a time, of tables of a gigabyte."""

Metres: TypeAlias = Annotated[float, Field(ge=-MAX_WORLD_M, le=MAX_WORLD_M)]


class Row(BaseModel):
    """A row of a table; keys that are not needed may hold anything."""

    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)

    token: str


class Placed(Row):
    """A row with a pose, which maps a sensor to the vehicle or the vehicle to the world."""

    translation: Annotated[tuple[Metres, ...], length(3, 3)]
    rotation: Vector4
    """Unit quaternion w x y z."""


class CalibratedSensor(Placed):
    """A sensor on a vehicle."""

    sensor_token: str
    camera_intrinsic: Annotated[tuple[Vector3, ...], length(0, 3)] = ()


class EgoPose(Placed):
    """The pose of the vehicle at a time."""


class Sensor(Row):
    """The name of a sensor's channel."""

    channel: str


class Scene(Row):
    """A scene, which is a sequence."""

    name: str


class Sample(Row):
    """A moment of a scene with keyframes."""

    scene_token: str


class SampleData(Row):
    """A file that a sensor recorded."""

    sample_token: str
    calibrated_sensor_token: str
    ego_pose_token: str
    filename: FileName
    timestamp: Annotated[int, Field(ge=0, le=int(MAX_STAMP_S * 1e6))]
    """Unix time in microseconds."""
    is_key_frame: bool
    width: int = 0
    height: int = 0


class Lidarseg(Row):
    """A file of point labels."""

    sample_data_token: str
    filename: FileName


Model = TypeVar("Model", bound=Row)
PlacedModel = TypeVar("PlacedModel", bound=Placed)


class Tables:
    """The tables in the folder of one version."""

    def __init__(self, folder: Path):
        self.folder = folder

    def path(self, table: str) -> Path:
        """Locate the file of a table."""
        return self.folder / f"{table}.json"

    def rows(self, table: str, model: type[Model]) -> list[Model]:
        """Read all rows of a table.

        Raises:
            InputError: the table does not exist, or one of its rows is wrong.
        """
        path, found = self.path(table), list[Model]()
        numbered = enumerate(read_rows(path))
        while some := dict(islice(numbered, ROWS_AT_A_TIME)):
            found += validate(RootModel[dict[int, model]], some, path).root.values()  # type: ignore[valid-type]
        return found

    def poses(self, table: str, model: type[PlacedModel], tokens: Collection[str]) -> dict[str, Pose]:
        """Read the transforms (4, 4) of the rows with these tokens, metres.

        Raises:
            InputError: a row is missing, or its quaternion does not have unit norm.
        """
        rows = {row.token: row for row in self.rows(table, model) if row.token in tokens}
        missing = sorted(set(tokens) - rows.keys())
        if missing:
            raise InputError(
                f"{self.path(table)}: found no row with token {describe(missing[0])}, needed one"
            )
        return {token: self._pose(table, row) for token, row in rows.items()}

    def _pose(self, table: str, row: Placed) -> Pose:
        w, x, y, z = row.rotation
        try:
            return pose_from_quaternion((x, y, z, w), row.translation)
        except ValueError as error:
            raise InputError(f"{self.path(table)}: row {describe(row.token)}: {error}") from None
