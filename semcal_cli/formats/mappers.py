"""Transforms in the settings of r3live and of Odin's driver, and the `extrinsic_matrix` of ros2_camera_lidar_fusion."""

from __future__ import annotations

from semcal_cli.formats.document_formats import entry_format, under
from semcal_cli.formats.format import FormatOptions, Source
from semcal_cli.formats.matrix import directed_format
from semcal_cli.formats.pose import MatrixNotation, RotationNotation, rounded
from semcal_cli.geometry.arrays import Pose

R3LIVE_KEY = "r3live_vio"
ODIN_KEY = "Tcl_0"
MATRIX_KEY = "extrinsic_matrix"


def _is_r3live(source: Source) -> bool:
    entry = source.mapping.get(R3LIVE_KEY)
    return isinstance(entry, dict) and "camera_ext_R" in entry


# r3live.hpp composes T_world_camera = T_world_imu T_imu_camera of these numbers.
R3LIVE = entry_format(
    "r3live",
    "p_imu = R p_camera + t, where the IMU inside the LiDAR, centimetres from its origin, stands for it: r3live_vio",
    _is_r3live,
    under(R3LIVE_KEY),
    RotationNotation("camera_ext_R", "camera_ext_t"),
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
