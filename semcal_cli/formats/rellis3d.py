"""RELLIS-3D's transforms.yaml: p_lidar = R(q) * p_camera + t, the inverse of T_camera_lidar.

The file does not say so; labels and pictures agree only in this direction.
"""

from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from semcal_cli.poses import Pose, inverse, pose_from_quaternion
from semcal_cli.validation import StrictModel, validate

KEY = "os1_cloud_node-pylon_camera_node"
"""Other files of the dataset have the same layout but relate two LiDARs; only the key tells them apart."""
KNOWN_AS = f"RELLIS-3D ({KEY})"


class _Quaternion(StrictModel):
    w: float
    x: float
    y: float
    z: float


class _Translation(StrictModel):
    x: float
    y: float
    z: float


class _Transform(StrictModel):
    q: _Quaternion
    t: _Translation

    @model_validator(mode="after")
    def _check_norm(self) -> "_Transform":
        self.T_lidar_camera()
        return self

    def T_lidar_camera(self) -> Pose:
        q, t = self.q, self.t
        return pose_from_quaternion((q.x, q.y, q.z, q.w), (t.x, t.y, t.z))


class _File(StrictModel):
    transform: _Transform = Field(validation_alias=KEY)


def recognises(document: dict[Any, Any]) -> bool:
    """Whether the document relates RELLIS-3D's Ouster and its camera."""
    return KEY in document


def read(document: dict[Any, Any], path: Path) -> Pose:
    """Read T_camera_lidar, inverting what the file states.

    Raises:
        InputError: a key is missing or wrong, or the quaternion is not of unit norm.
    """
    return inverse(validate(_File, document, path).transform.T_lidar_camera())
