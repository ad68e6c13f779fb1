"""Transforms in the settings of r3live and of Odin's driver, and the `extrinsic_matrix` of ros2_camera_lidar_fusion."""

from __future__ import annotations

from typing import Any

from semcal_cli.formats.document_formats import entry_format, under
from semcal_cli.formats.format import FormatOptions, Source
from semcal_cli.formats.matrix import directed_format
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import MatrixNotation, check_transform, rounded, transform
from semcal_cli.geometry.arrays import Pose

R3LIVE_KEY = "r3live_vio"
ODIN_KEY = "Tcl_0"
MATRIX_KEY = "extrinsic_matrix"


class _CameraOnImu:
    """A pose as camera_ext_R, nine numbers by rows, and camera_ext_t."""

    def read(self, node: Node, options: FormatOptions) -> Pose:
        R = node.at("camera_ext_R")
        T = transform(R.matrix(3, 3), node.at("camera_ext_t").numbers(3))
        return check_transform(R.where, T, options)

    def put(self, entry: dict[Any, Any], T: Pose) -> None:
        entry["camera_ext_R"], entry["camera_ext_t"] = rounded(T[:3, :3].ravel()), rounded(T[:3, 3])


def _is_r3live(source: Source) -> bool:
    entry = source.mapping.get(R3LIVE_KEY)
    return isinstance(entry, dict) and "camera_ext_R" in entry


# r3live.hpp composes T_world_camera = T_world_imu T_imu_camera of these numbers.
R3LIVE = entry_format(
    "r3live",
    "p_imu = R p_camera + t, where the IMU inside the LiDAR, centimetres from its origin, stands for it: r3live_vio",
    _is_r3live,
    under(R3LIVE_KEY),
    _CameraOnImu(),
    maps_camera=True,
)
ODIN = entry_format(
    "odin",
    f"p_camera = T p_lidar: {ODIN_KEY}",
    lambda source: ODIN_KEY in source.mapping,
    under(),
    MatrixNotation(ODIN_KEY),
)


def _read_matrix(source: Source, options: FormatOptions) -> Pose:
    entry = source.node.at(MATRIX_KEY)
    if isinstance(entry.value, dict):
        return MatrixNotation("data").read(entry, options)
    return MatrixNotation(MATRIX_KEY).read(source.node, options)


EXTRINSIC_MATRIX = directed_format(
    "extrinsic-matrix",
    f"{MATRIX_KEY}, 4 x 4 or 3 x 4, YAML or JSON",
    lambda source: MATRIX_KEY in source.mapping,
    _read_matrix,
    lambda T, options: {MATRIX_KEY: rounded(T)},
)
