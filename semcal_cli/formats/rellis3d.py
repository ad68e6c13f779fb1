"""RELLIS-3D's transforms.yaml: p_lidar = R(q) * p_camera + t, the inverse of T_camera_lidar.

The file does not state its direction; labels and images agree only in this one.
"""

from __future__ import annotations

from typing import Any

from pydantic import Field

from semcal_cli.files.validation import StrictModel, validate
from semcal_cli.formats.format import (
    Format,
    FormatOptions,
    Source,
    document_writer,
    from_quaternion,
    wxyz,
    xyz,
)
from semcal_cli.geometry.poses import Pose, inverse

KEY = "os1_cloud_node-pylon_camera_node"
"""Key of the LiDAR and camera; other files of the dataset have the same layout but relate two LiDARs."""


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


class _File(StrictModel):
    transform: _Transform = Field(validation_alias=KEY)


def _read(source: Source, options: FormatOptions) -> Pose:
    transform = validate(_File, source.document, source.path).transform
    q, t = transform.q, transform.t
    where = f"{source.path}: ['{KEY}']"
    return inverse(from_quaternion(where, [q.x, q.y, q.z, q.w], [t.x, t.y, t.z], options))


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    T = inverse(T_camera_lidar)
    transform = document.setdefault(KEY, {})
    for name, keys, values in (("q", "wxyz", wxyz(T)), ("t", "xyz", xyz(T))):
        transform.setdefault(name, {}).update(zip(keys, values, strict=True))


FORMAT = Format(
    "rellis-3d",
    f"p_lidar = T p_camera: transforms.yaml, {KEY}",
    lambda source: KEY in source.mapping,
    _read,
    document_writer(_put),
    _put,
)
